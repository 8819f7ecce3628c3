//! Video memory of a scene: its records, and what the stages hand each other.

use std::sync::Arc;

use pairmask_shaders::layouts::{GridLayout, SceneParams, SceneSummary};

use super::plan::{MOST_SLOTS, PAIR_BYTES, Room, SORTED_BYTES, Sizes};
use crate::execute::gpu::{
    Block, Command, Frame, GpuError, Growing, Home, Part, SceneTools, frame_blocks,
};

pub(super) const RECORD_BYTES: u64 = 32;
/// Bytes of an entry before it has its place.
const ENTRY_BYTES: u64 = 16;
/// Records that a scene has room for, at least: smaller blocks save nothing.
const LEAST_SLOTS: u64 = 4_096;
/// Records that a scene may keep room for however small it is, 2 MiB: queries of small scenes need room behind
/// its own, and edits between them do not.
const KEPT_SLOTS: u64 = 65_536;

/// Bytes that each block may keep for each index, regardless of what the last edit needed: small and large edits
/// take turns without a block being made anew, which takes a millisecond.
const KEPT_BYTES_A_SLOT: u64 = 96;
/// Blocks up to this size are kept regardless of the scene's: a large page.
const KEPT_BYTES: u64 = 2 << 20;

/// Boxes as they are, and as they were when the history began.
struct Records {
    slots: u64,
    now: Arc<Block>,
    then: Arc<Block>,
}

pub(super) struct Memory {
    records: Option<Records>,
    /// There once pairs of moved boxes were asked for.
    pub named: Option<Arc<Block>>,
    stages: Stages,
}

frame_blocks! { Stages, StageParts:
    params in Host,
    grid in Host,
    table in Video,
    control in Video,
    entries in Video,
    sorted in Video,
    found in Host,
    summary in Host,
    unsorted in Video,
    rows in Video,
    counts in Video,
    starts in Video,
}

#[derive(Clone)]
pub(super) struct Blocks {
    pub now: Part,
    pub then: Part,
    /// The control block where none is named.
    pub named: Part,
    /// What the stages hand each other. Of queries alone: pairs as they are found, and those of each query together
    /// (`unsorted`, `rows`); how many each has, and where they begin (`counts`, `starts`). Else these are the control
    /// block.
    pub stages: StageParts,
}

impl std::ops::Deref for Blocks {
    type Target = StageParts;

    fn deref(&self) -> &StageParts {
        &self.stages
    }
}

impl Memory {
    pub fn new(tools: &SceneTools) -> Self {
        let written = Home::written(&tools.gpu);
        let [params, grid] = [(); 2].map(|()| Growing::new(written));
        Self { records: None, named: None, stages: Stages { params, grid, ..Stages::new() } }
    }

    /// Bytes that are allocated, in video memory for the most part.
    pub fn bytes(&self) -> u64 {
        let records = self.records.as_ref().map_or(0, |r| r.now.bytes() + r.then.bytes());
        let named = self.named.as_ref().map_or(0, |named| named.bytes());
        let Stages { params, grid, table, control, entries, sorted, .. } = &self.stages;
        let Stages { found, summary, unsorted, rows, counts, starts, .. } = &self.stages;
        let scratch = [params, grid, table, control, entries, sorted];
        let scratch = scratch.into_iter().chain([found, summary, unsorted, rows, counts, starts]);
        records + named + scratch.map(Growing::held_bytes).sum::<u64>()
    }

    /// Records of the boxes as they are.
    pub fn records_now(&self) -> Option<&Arc<Block>> {
        self.records.as_ref().map(|records| &records.now)
    }

    /// Room for records of `slots` indices. `replaced` is set if blocks are others.
    pub fn make_records(
        &mut self,
        tools: &SceneTools,
        slots: u64,
        replaced: &mut bool,
    ) -> Result<(), GpuError> {
        let most = (tools.binding_bytes / RECORD_BYTES).min(MOST_SLOTS);
        if slots > most {
            return Err(GpuError::OutOfMemory { bytes: slots * RECORD_BYTES });
        }
        let held = self.records.as_ref().map_or(0, |records| records.slots);
        let requested = (slots + slots / 2).max(LEAST_SLOTS).min(most);
        // A scene that has shrunk much gives its memory back.
        if slots <= held && held <= (4 * requested).max(KEPT_SLOTS) {
            return Ok(());
        }
        *replaced = true;
        let made = Self::new_records(tools, requested);
        let made = made.or_else(|_| Self::new_records(tools, slots))?;
        let mut steps = Vec::new();
        for block in [&made.now, &made.then] {
            // Zero is an index without a box that has never changed.
            steps.push(Command::Fill { part: Part::whole(block), word: 0 });
        }
        if let Some(old) = &self.records {
            let bytes = old.slots.min(made.slots) * RECORD_BYTES;
            for (from, to) in [(&old.now, &made.now), (&old.then, &made.then)] {
                steps.push(Command::Copy {
                    from: Part::of(from, 0, bytes),
                    to: Part::of(to, 0, bytes),
                });
            }
        }
        Frame::run_once(&tools.gpu, steps)?;
        self.records = Some(made);
        self.named = None;
        Ok(())
    }

    fn new_records(tools: &SceneTools, slots: u64) -> Result<Records, GpuError> {
        let block = || Block::new(&tools.gpu, Home::Video, slots * RECORD_BYTES);
        Ok(Records { slots, now: block()?, then: block()? })
    }

    /// Drops which boxes were named: namings may be numbered from 1 again.
    pub fn discard_named(
        &mut self,
        tools: &SceneTools,
        replaced: &mut bool,
    ) -> Result<(), GpuError> {
        let slots = self.records.as_ref().map_or(0, |records| records.slots);
        let bytes = size_of::<u32>() as u64 * slots;
        let block = if let Some(block) = self.named.take() {
            block
        } else {
            *replaced = true;
            Block::new(&tools.gpu, Home::Video, bytes)?
        };
        Frame::fill(&tools.gpu, [&block], 0)?;
        self.named = Some(block);
        Ok(())
    }

    pub fn blocks(
        &mut self,
        tools: &SceneTools,
        sizes: &Sizes,
        room: Room,
        replaced: &mut bool,
    ) -> Result<Blocks, GpuError> {
        let most = tools.binding_bytes;
        let records = self.records.as_ref().ok_or(GpuError::Lost)?;
        let mut was_replaced = false;
        let slots = records.slots;
        let whole = |block: &Arc<Block>| Part::of(block, 0, block.bytes().min(most));
        let mut part = |growing: &mut Growing, bytes: u64| {
            if bytes > most {
                return Err(GpuError::OutOfMemory { bytes });
            }
            let kept = 2 * bytes.max(KEPT_BYTES_A_SLOT * slots).max(KEPT_BYTES);
            growing.at_least(&tools.gpu, bytes, kept, &mut was_replaced).map(whole)
        };
        let s = &mut self.stages;
        let control = part(&mut s.control, 4 * sizes.control_words)?;
        let pair_bytes = PAIR_BYTES * room.pairs;
        let (has_queries, query_bytes) = (sizes.queries > 0, 4 * sizes.queries);
        let mut of_queries = |growing: &mut Growing, bytes| {
            if has_queries { part(growing, bytes) } else { Ok(control.clone()) }
        };
        let unsorted = of_queries(&mut s.unsorted, pair_bytes)?;
        let rows = of_queries(&mut s.rows, pair_bytes)?;
        let counts = of_queries(&mut s.counts, query_bytes)?;
        let starts = of_queries(&mut s.starts, query_bytes)?;
        let stages = StageParts {
            params: part(&mut s.params, size_of::<SceneParams>() as u64)?,
            grid: part(&mut s.grid, size_of::<GridLayout>() as u64)?,
            table: part(&mut s.table, sizes.table_bytes())?,
            entries: part(&mut s.entries, ENTRY_BYTES * room.entries)?,
            sorted: part(&mut s.sorted, SORTED_BYTES * room.entries)?,
            found: part(&mut s.found, pair_bytes)?,
            summary: part(&mut s.summary, size_of::<SceneSummary>() as u64)?,
            unsorted,
            rows,
            counts,
            starts,
            control,
        };
        if let (true, Some(word)) = (was_replaced, tools.poison) {
            let named = stages.named();
            let all = named.iter().filter(|(name, _)| !["params", "grid"].contains(name));
            Frame::fill(&tools.gpu, all.map(|(_, part)| &part.block), word)?;
        }
        let named = self.named.as_ref().map_or_else(|| stages.control.clone(), whole);
        *replaced |= was_replaced;
        Ok(Blocks { now: whole(&records.now), then: whole(&records.then), named, stages })
    }
}
