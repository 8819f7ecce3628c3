//! The sweep on a device.

use std::sync::Arc;

use bytemuck::cast_slice;
use pairmask_core::Aabb;
use pairmask_shaders::constants::BATCH_BOXES;
use pairmaskd::execute::gpu::{Block, Checks, Command, Frame, Gpu, GpuError, Part, StepTime};

use super::layouts::{CONTROL_WORDS, DIGIT_BITS, DIGITS, SweepParams, TILE};
use super::plan::SweepPlan;
use super::stage::SweepStage;
use crate::study::harness::stage_bench::StageBench;

/// Why a scene was not swept.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// More pairs than one binding holds, more boxes than one dispatch takes, or more in one place than a thread may
    /// test.
    #[error("too many boxes in one place for the sweep")]
    TooCrowded,
}

/// Sweep and prune on a GPU: boxes up, entries sorted, each against those behind it, pairs down.
pub struct GpuSweep {
    bench: StageBench<SweepStage>,
    /// Pairs that the last scene had.
    last_found: u64,
}

/// What a sweep found.
#[derive(Clone, Debug)]
pub struct Swept {
    /// Pairs of indices, the smaller one first, in no order.
    pub pairs: Vec<[u32; 2]>,
    /// Pairs that were tested; those of boxes that share several tubes count as often.
    pub tested: u64,
    /// Entries: boxes, once for each tube that they lie in.
    pub entries: u32,
    /// The plan that it went by.
    pub plan: SweepPlan,
}

/// Memory of a sweep.
struct Blocks {
    boxes: Arc<Block>,
    video_boxes: Arc<Block>,
    control: Arc<Block>,
    told_control: Arc<Block>,
    records: Arc<Block>,
    keys: [Arc<Block>; 2],
    values: [Arc<Block>; 2],
    counts: Arc<Block>,
    sorted: Arc<Block>,
    found: Arc<Block>,
    told: Arc<Block>,
}

/// A scene whose room is known: its steps, recorded.
pub struct RecordedSweep {
    frame: Frame,
    blocks: Blocks,
    plan: SweepPlan,
}

/// Room for entries and pairs.
#[derive(Clone, Copy)]
struct Room {
    entries: u32,
    pairs: u64,
}

/// Words of the control block that the host reads.
struct Control {
    entries: u32,
    found: u32,
    tested: u64,
    too_much: bool,
}

impl GpuSweep {
    /// A sweep on `gpu`; stages are compiled when they are first used.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Arc<Gpu>, checks: Checks) -> Result<Self, GpuError> {
        Ok(Self { bench: StageBench::new(gpu, checks)?, last_found: 0 })
    }

    /// The device.
    pub fn gpu(&self) -> &Arc<Gpu> {
        self.bench.gpu()
    }

    /// The pairs of a scene.
    ///
    /// # Errors
    /// [`SweepError`].
    pub fn pairs(&mut self, boxes: &[Aabb]) -> Result<Swept, SweepError> {
        Ok(self.recorded(boxes)?.1)
    }

    /// The pairs of a scene, and its steps with room for just those, to be run again.
    ///
    /// # Errors
    /// [`SweepError`].
    pub fn recorded(&mut self, boxes: &[Aabb]) -> Result<(RecordedSweep, Swept), SweepError> {
        let mut plan = SweepPlan::of(boxes);
        let n = boxes.len() as u32;
        let mut room = Room { entries: (2 * n).max(TILE), pairs: self.last_found.max(1) };
        loop {
            let mut sweep = self.record(boxes, plan, room)?;
            self.bench.run(&mut sweep.frame)?;
            let control = sweep.control();
            if control.entries > room.entries {
                // One tube has each box once, for which there is room.
                plan = plan.with_fewer_tubes().ok_or(SweepError::TooCrowded)?;
                continue;
            }
            if control.too_much {
                return Err(SweepError::TooCrowded);
            }
            // Room for just those, so that no more comes down.
            let found = u64::from(control.found);
            if room.pairs != found.max(1) {
                room.pairs = found.max(1);
                continue;
            }
            self.last_found = found;
            let mut pairs = vec![[0; 2]; control.found as usize];
            sweep.blocks.told.read(0, &mut pairs);
            let Control { entries, tested, .. } = control;
            return Ok((sweep, Swept { pairs, tested, entries, plan }));
        }
    }

    /// Runs a scene again; the time of each step.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn run(&self, sweep: &mut RecordedSweep) -> Result<Vec<StepTime>, GpuError> {
        self.bench.run(&mut sweep.frame)
    }

    fn blocks(&self, n: u32, room: Room, tiles: u32) -> Result<Blocks, SweepError> {
        let found_bytes = 8 * room.pairs;
        let sorted_bytes = 32 * u64::from(room.entries);
        let most = self.gpu().limits().storage_binding_bytes;
        let most_groups = self.gpu().limits().dispatch_groups;
        let too_many = room.entries.div_ceil(BATCH_BOXES) > most_groups;
        if found_bytes.max(sorted_bytes) > most || too_many {
            return Err(SweepError::TooCrowded);
        }
        let bench = &self.bench;
        let box_bytes = size_of::<Aabb>() as u64 * u64::from(n.max(1));
        let control_bytes = 4 * CONTROL_WORDS as u64;
        let words = || bench.video(4 * u64::from(room.entries));
        Ok(Blocks {
            boxes: bench.host(box_bytes)?,
            video_boxes: bench.video(box_bytes)?,
            control: bench.video(control_bytes)?,
            told_control: bench.host(control_bytes)?,
            records: bench.video(32 * u64::from(n.max(1)))?,
            keys: [words()?, words()?],
            values: [words()?, words()?],
            counts: bench.video(4 * u64::from(DIGITS * tiles))?,
            sorted: bench.video(sorted_bytes)?,
            found: bench.video(found_bytes)?,
            told: bench.host(found_bytes)?,
        })
    }

    fn record(
        &mut self,
        boxes: &[Aabb],
        plan: SweepPlan,
        room: Room,
    ) -> Result<RecordedSweep, SweepError> {
        let n = boxes.len() as u32;
        let tiles = room.entries.div_ceil(TILE);
        let blocks = self.blocks(n, room, tiles)?;
        blocks.boxes.write(0, cast_slice::<_, f32>(boxes));
        let params = SweepParams {
            n,
            entry_capacity: room.entries,
            pair_capacity: u32::try_from(room.pairs).map_err(|_| SweepError::TooCrowded)?,
            tiles,
            // The limit is for threads that keep each other waiting; these go through their loops together.
            thread_rounds: self.gpu().limits().thread_rounds.saturating_mul(8),
            ..plan.params()
        };
        let bench = &mut self.bench;
        let Blocks { control, records, counts, sorted, found, .. } = &blocks;
        let whole_copy = |from: &Arc<Block>, to: &Arc<Block>| Command::Copy {
            from: Part::of(from, 0, from.bytes().min(to.bytes())),
            to: Part::of(to, 0, from.bytes().min(to.bytes())),
        };
        let batches = [n.div_ceil(BATCH_BOXES).max(1), 1];
        let entry_batches = [room.entries.div_ceil(BATCH_BOXES), 1];
        let mut steps = vec![
            whole_copy(&blocks.boxes, &blocks.video_boxes),
            Command::Fill { part: Part::whole(control), word: 0 },
            bench.command(
                SweepStage::Keys,
                &[&blocks.video_boxes, control, records, &blocks.keys[0], &blocks.values[0]],
                &params,
                batches,
            )?,
        ];
        for pass_number in 0..plan.passes() {
            let [from, to] = if pass_number % 2 == 0 { [0, 1] } else { [1, 0] };
            let (keys, values) = (&blocks.keys, &blocks.values);
            let params = SweepParams { pass_number, shift: pass_number * DIGIT_BITS, ..params };
            steps.extend([
                bench.command(
                    SweepStage::Count,
                    &[control, &keys[from], counts],
                    &params,
                    [tiles, 1],
                )?,
                bench.command(SweepStage::Scan, &[control, counts], &params, [DIGITS, 1])?,
                bench.command(
                    SweepStage::Scatter,
                    &[control, &keys[from], counts, &values[from], &keys[to], &values[to]],
                    &params,
                    [tiles, 1],
                )?,
            ]);
        }
        let last = (plan.passes() % 2) as usize;
        let (keys, values) = (&blocks.keys[last], &blocks.values[last]);
        steps.extend([
            bench.command(
                SweepStage::Gather,
                &[control, values, records, sorted],
                &params,
                entry_batches,
            )?,
            bench.command(
                SweepStage::Pairs,
                &[control, keys, values, sorted, found],
                &params,
                entry_batches,
            )?,
            whole_copy(control, &blocks.told_control),
            whole_copy(found, &blocks.told),
        ]);
        let frame = bench.frame(steps)?;
        Ok(RecordedSweep { frame, blocks, plan })
    }
}

impl RecordedSweep {
    /// Passes of its sort.
    pub const fn passes(&self) -> u32 {
        self.plan.passes()
    }

    fn control(&self) -> Control {
        let mut words = [0u32; 5];
        self.blocks.told_control.read(0, &mut words);
        let [entries, found, low, high, too_much] = words;
        let tested = u64::from(low) | u64::from(high) << 32;
        Control { entries, found, tested, too_much: too_much != 0 }
    }
}
