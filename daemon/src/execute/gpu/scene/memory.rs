//! Video memory of a scene: its records, and what the stages hand each other.

use std::sync::Arc;
use std::time::Duration;

use pairmask_shaders::layouts::{GridLayout, SceneParams, SceneSummary};

use super::plan::{MOST_SLOTS, PAIR_BYTES, Room, SORTED_BYTES, Sizes};
use crate::execute::gpu::{Block, Command, Frame, GpuError, Home, Part, SceneTools, frame_blocks};

/// Bytes of a record.
pub(super) const RECORD_BYTES: u64 = 32;
/// Bytes of an entry before it has its place.
const ENTRY_BYTES: u64 = 16;
/// Records that a scene has room for, at least: smaller blocks save nothing.
const LEAST_SLOTS: u64 = 4_096;
/// Records that a scene may keep room for however small it is, 2 MiB: queries of small scenes need room behind
/// its own, and edits between them do not.
const KEPT_SLOTS: u64 = 65_536;
/// How long copies and fills may take before the device counts as hung.
const PATIENCE: Duration = Duration::from_secs(10);

/// Bytes that each block may keep for each index, whatever the last edit needed: small and large edits
/// take turns without a block being made anew, which takes a millisecond.
const KEPT_BYTES_A_SLOT: u64 = 96;
/// Blocks up to this size are kept whatever the scene's: a large page.
const KEPT_BYTES: u64 = 2 << 20;

/// A block that is made anew, larger, when more is asked of it, and smaller when the scene has shrunk.
struct Scratch {
    home: Home,
    block: Option<Arc<Block>>,
}

impl Scratch {
    const fn new(home: Home) -> Self {
        Self { home, block: None }
    }

    fn bytes(&self) -> u64 {
        self.block.as_ref().map_or(0, |block| block.bytes())
    }

    /// A block of at least `bytes` for a scene of so many indices. `replaced` is set if it is not the one
    /// of last time.
    fn at_least(
        &mut self,
        tools: &SceneTools,
        bytes: u64,
        slots: u64,
        replaced: &mut bool,
    ) -> Result<Arc<Block>, GpuError> {
        let most = 2 * bytes.max(KEPT_BYTES_A_SLOT * slots).max(KEPT_BYTES);
        let kept = self.block.take().filter(|b| b.bytes() >= bytes && b.bytes() <= most);
        let block = if let Some(block) = kept {
            block
        } else {
            *replaced = true;
            // A quarter more, so that a slowly growing scene does not allocate each time; the bare size
            // when that is too much.
            let roomy = Block::new(&tools.gpu, self.home, bytes + bytes / 4);
            roomy.or_else(|_| Block::new(&tools.gpu, self.home, bytes))?
        };
        Ok(Arc::clone(self.block.insert(block)))
    }
}

/// Boxes as they are, and as they were when the history began.
struct Records {
    slots: u64,
    now: Arc<Block>,
    then: Arc<Block>,
}

/// All video memory of a scene.
pub(super) struct Memory {
    records: Option<Records>,
    /// There once pairs of moved boxes were asked for.
    named: Option<Arc<Block>>,
    stages: Stages,
}

frame_blocks! { Stages of Scratch, StageBlocks:
    params in Host,
    layout in Host,
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

/// The blocks of one search.
#[derive(Clone)]
pub(super) struct Blocks {
    pub now: Arc<Block>,
    pub then: Arc<Block>,
    /// The control block where none is named.
    pub named: Arc<Block>,
    /// What the stages hand each other. Of queries alone: pairs as they are found, and those of each query together
    /// (`unsorted`, `rows`); how many each has, and where they begin (`counts`, `starts`). Else these are the control
    /// block.
    pub stages: StageBlocks,
}

impl std::ops::Deref for Blocks {
    type Target = StageBlocks;

    fn deref(&self) -> &StageBlocks {
        &self.stages
    }
}

impl Memory {
    pub fn new(tools: &SceneTools) -> Self {
        let written = Home::written(&tools.gpu);
        let [params, layout] = [(); 2].map(|()| Scratch::new(written));
        Self { records: None, named: None, stages: Stages { params, layout, ..Stages::new() } }
    }

    /// Bytes that are allocated, in video memory for the most part.
    pub fn bytes(&self) -> u64 {
        let records = self.records.as_ref().map_or(0, |r| r.now.bytes() + r.then.bytes());
        let named = self.named.as_ref().map_or(0, |named| named.bytes());
        let Stages { params, layout, table, control, entries, sorted, found, summary, .. } =
            &self.stages;
        let Stages { unsorted, rows, counts, starts, .. } = &self.stages;
        let scratch = [params, layout, table, control, entries, sorted, found, summary];
        let scratch = scratch.into_iter().chain([unsorted, rows, counts, starts]);
        records + named + scratch.map(Scratch::bytes).sum::<u64>()
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
        let wanted = (slots + slots / 2).max(LEAST_SLOTS).min(most);
        // A scene that has shrunk much gives its memory back.
        if slots <= held && held <= (4 * wanted).max(KEPT_SLOTS) {
            return Ok(());
        }
        *replaced = true;
        let made = Self::new_records(tools, wanted);
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
        run_once(tools, steps)?;
        self.records = Some(made);
        self.named = None;
        Ok(())
    }

    fn new_records(tools: &SceneTools, slots: u64) -> Result<Records, GpuError> {
        let block = || Block::new(&tools.gpu, Home::Video, slots * RECORD_BYTES);
        Ok(Records { slots, now: block()?, then: block()? })
    }

    /// Forgets which boxes were named, so that namings may be numbered from 1 again; there is memory for
    /// them then.
    pub fn forget_named(
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
        run_once(tools, vec![Command::Fill { part: Part::whole(&block), word: 0 }])?;
        self.named = Some(block);
        Ok(())
    }

    /// Whether there is memory for names.
    pub const fn has_named(&self) -> bool {
        self.named.is_some()
    }

    /// The blocks of a search.
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
        let mut block = |scratch: &mut Scratch, bytes: u64| {
            if bytes > most {
                return Err(GpuError::OutOfMemory { bytes });
            }
            scratch.at_least(tools, bytes, slots, &mut was_replaced)
        };
        let s = &mut self.stages;
        let control = block(&mut s.control, 4 * sizes.control_words)?;
        let pair_bytes = PAIR_BYTES * room.pairs;
        let (has_queries, query_bytes) = (sizes.queries > 0, 4 * sizes.queries);
        let mut of_queries = |scratch: &mut Scratch, bytes| {
            if has_queries { block(scratch, bytes) } else { Ok(Arc::clone(&control)) }
        };
        let unsorted = of_queries(&mut s.unsorted, pair_bytes)?;
        let rows = of_queries(&mut s.rows, pair_bytes)?;
        let counts = of_queries(&mut s.counts, query_bytes)?;
        let starts = of_queries(&mut s.starts, query_bytes)?;
        let stages = StageBlocks {
            params: block(&mut s.params, size_of::<SceneParams>() as u64)?,
            layout: block(&mut s.layout, size_of::<GridLayout>() as u64)?,
            table: block(&mut s.table, sizes.table_bytes())?,
            entries: block(&mut s.entries, ENTRY_BYTES * room.entries)?,
            sorted: block(&mut s.sorted, SORTED_BYTES * room.entries)?,
            found: block(&mut s.found, pair_bytes)?,
            summary: block(&mut s.summary, size_of::<SceneSummary>() as u64)?,
            unsorted,
            rows,
            counts,
            starts,
            control,
        };
        if let (true, Some(word)) = (was_replaced, tools.poison) {
            let StageBlocks { table, control, entries, sorted, found, summary, .. } = &stages;
            let StageBlocks { unsorted, rows, counts, starts, .. } = &stages;
            let all =
                [table, control, entries, sorted, found, summary, unsorted, rows, counts, starts];
            let fill = |block: &Arc<Block>| Command::Fill { part: Part::whole(block), word };
            run_once(tools, all.map(fill).into())?;
        }
        let (now, then) = (Arc::clone(&records.now), Arc::clone(&records.then));
        let named = Arc::clone(self.named.as_ref().unwrap_or(&stages.control));
        let blocks = Blocks { now, then, named, stages };
        *replaced |= was_replaced;
        Ok(blocks)
    }
}

/// Runs some steps and waits for them.
fn run_once(tools: &SceneTools, steps: Vec<Command>) -> Result<(), GpuError> {
    let mut frame = Frame::new(&tools.gpu, false)?;
    frame.record(steps)?;
    frame.run(tools.wait, PATIENCE)
}
