//! The variants on a GPU: answers, errors, times by its own clock, and all pairs by the paper's mapping.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytemuck::{Pod, cast_slice};
use pairmask_core::aabb::KeyBox;
use pairmask_core::{Aabb, BoxCount};
use pairmask_shaders::constants::BATCH_BOXES;
use pairmaskd::execute::gpu::{
    Block, Checks, Command, Frame, Gpu, GpuError, Home, Part, Pipeline, Pipelines, StepTime,
};

use super::Plan;
use super::errors::{RootTally, Tally, bounded, counted};
use super::stage::{ERRORS, MASK, MASK_OR, MappingStage, ROOT_ERRORS, Root, Variant};
use crate::study::harness::{Fields, median, repeated};

const WORD_IDS: u64 = 32;

/// Time after which a frame is given up: a thousand times a GPU's need, enough for a software adapter.
const TIMEOUT: Duration = Duration::from_secs(120);

/// A device and the stages of the study, each compiled when it is first asked for.
pub struct Bench {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
    made: HashMap<MappingStage, Arc<Pipeline>>,
}

impl Bench {
    pub fn new(gpu: &Arc<Gpu>, checks: Checks) -> Result<Self, GpuError> {
        let pipelines = Pipelines::new(gpu, checks, None)?;
        Ok(Self { gpu: Arc::clone(gpu), pipelines, made: HashMap::new() })
    }

    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    fn command(
        &mut self,
        stage: MappingStage,
        blocks: &[&Arc<Block>],
        immediates: &impl Pod,
        groups: [u32; 2],
    ) -> Result<Command, GpuError> {
        let pipeline = if let Some(made) = self.made.get(&stage) {
            Arc::clone(made)
        } else {
            let pipeline = self.pipelines.compile(&stage.composed())?;
            self.made.insert(stage, Arc::clone(&pipeline));
            pipeline
        };
        Ok(Command::Stage {
            pipeline,
            parts: blocks.iter().map(|block| Part::whole(block)).collect(),
            immediates: bytemuck::bytes_of(immediates).to_vec(),
            groups,
        })
    }

    pub(crate) fn frame(&self, steps: Vec<Command>) -> Result<Frame, GpuError> {
        let mut frame = Frame::new(&self.gpu, true)?;
        frame.record(steps)?;
        Ok(frame)
    }

    pub(crate) fn run(frame: &mut Frame) -> Result<Vec<StepTime>, GpuError> {
        frame.run(TIMEOUT)?;
        frame.step_times()
    }

    pub(super) fn run_stage(
        &mut self,
        stage: MappingStage,
        blocks: &[&Arc<Block>],
        params: &impl Pod,
        groups: [u32; 2],
    ) -> Result<(), GpuError> {
        let step = self.command(stage, blocks, params, groups)?;
        let mut frame = self.frame(vec![step])?;
        Self::run(&mut frame).map(drop)
    }

    pub(crate) fn block(&self, home: Home, bytes: u64) -> Result<Arc<Block>, GpuError> {
        Block::new(&self.gpu, home, bytes)
    }

    /// Workgroups that cover `threads`: as a square, so that neither side passes the limit.
    pub(super) fn groups(&self, threads: u64) -> Option<[u32; 2]> {
        let groups = threads.div_ceil(u64::from(BATCH_BOXES)).max(1);
        let limit = u64::from(self.gpu.limits().dispatch_groups);
        let x = groups.min(limit);
        let y = groups.div_ceil(x);
        (y <= limit).then_some([x as u32, y as u32])
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ids {
    All,
    /// Words of 32 ids, as many as given, evenly apart.
    Words(u32),
    /// Sixteen ids on either side of the start of each row.
    AroundRows,
}

/// Counts the wrong ids; `None` where they do not fit the device's integers, counters or dispatches.
pub fn count(
    bench: &mut Bench,
    variant: Variant,
    n: u32,
    ids: Ids,
) -> Result<Option<(Tally, Fields)>, GpuError> {
    let total = variant.id_count(n);
    // The device counts in 32 bits.
    let too_many = ids == Ids::All && u32::try_from(total).is_err();
    let is_wide = variant.is_wide(n);
    if total == 0 || too_many || is_wide && !bench.gpu.limits().int64 {
        return Ok(None);
    }
    let (words, stride, around_rows) = match ids {
        Ids::All => (total.div_ceil(WORD_IDS), WORD_IDS, 0),
        Ids::Words(words) => {
            let words = u64::from(words).min(total.div_ceil(WORD_IDS)).max(1);
            (words, (total / words).max(WORD_IDS), 0)
        }
        Ids::AroundRows => (u64::from(n) - 1, 0, 1),
    };
    let pairs = BoxCount::new(n).pair_count();
    let map_bytes = pairs.div_ceil(32) * 4;
    let mark = ids == Ids::All
        && u32::try_from(pairs).is_ok()
        && map_bytes <= bench.gpu().limits().storage_binding_bytes;
    let Some(groups) = bench.groups(words) else { return Ok(None) };
    let stride = [stride as u32, (stride >> 32) as u32];
    let params = [n, words as u32, groups[0], around_rows, 0, 0, stride[0], stride[1], mark.into()];
    let tally = bench.block(Home::Host, size_of::<[u32; 6]>() as u64)?;
    tally.write(0, &[0u32; 6]);
    let named = bench.block(Home::Video, if mark { map_bytes } else { 4 })?;
    let stage = MappingStage::Map(ERRORS, variant, is_wide);
    let count = bench.command(stage, &[&tally, &named], &params, groups)?;
    let clear = Command::Fill { part: Part::whole(&named), word: 0 };
    let mut frame = bench.frame(vec![clear, count])?;
    Bench::run(&mut frame)?;
    let mut counts = [0u32; 6];
    tally.read(0, &mut counts);
    let [ids, skipped, wrong, wrong_named, largest_row_error, distinct] = counts.map(u64::from);
    let tally = Tally { ids, skipped, wrong, wrong_named, largest_row_error, first_wrong: None };
    let coverage = if mark { counted(&tally, pairs, distinct) } else { bounded(&tally) };
    Ok(Some((tally, coverage)))
}

pub fn count_roots(
    bench: &mut Bench,
    root: Root,
    count: u32,
) -> Result<Option<RootTally>, GpuError> {
    let words = u64::from(count).div_ceil(WORD_IDS);
    let Some(groups) = bench.groups(words) else { return Ok(None) };
    let params = [count, words as u32, groups[0], 0];
    let tally = bench.block(Home::Host, size_of::<[u32; 2]>() as u64)?;
    tally.write(0, &[0u32; 2]);
    bench.run_stage(MappingStage::Root(ROOT_ERRORS, root), &[&tally], &params, groups)?;
    let mut counts = [0u32; 2];
    tally.read(0, &mut counts);
    let [other, inexact] = counts.map(u64::from);
    Ok(Some(RootTally { count: u64::from(count), other, inexact }))
}

/// A sum that no thread is expected to have.
const NEVER: u32 = 0xdead_beef;

/// Words of a trial run, from which it is estimated whether the whole run fits the budget.
const TRIAL_WORDS: u64 = 1 << 15;

/// Median time in ms of a stage for so many boxes or numbers, which have `ids`; `None` where they do not fit the
/// device, or would take longer than the plan allows.
pub fn ms(
    bench: &mut Bench,
    stage: MappingStage,
    n: u32,
    ids: u64,
    plan: &Plan,
) -> Result<Option<f64>, GpuError> {
    if matches!(stage, MappingStage::Map(.., true)) && !bench.gpu.limits().int64 {
        return Ok(None);
    }
    let words = ids.div_ceil(WORD_IDS);
    let sink = bench.block(Home::Video, 4)?;
    let frame_of = |bench: &mut Bench, words: u64| {
        let Some(groups) = bench.groups(words).filter(|_| words > 0) else { return Ok(None) };
        let step = bench.command(stage, &[&sink], &[n, words as u32, groups[0], NEVER], groups)?;
        bench.frame(vec![step]).map(Some)
    };
    if words > TRIAL_WORDS
        && let Some(mut trial) = frame_of(bench, TRIAL_WORDS)?
    {
        // The first run compiles and wakes the device.
        Bench::run(&mut trial)?;
        let ns: f64 = Bench::run(&mut trial)?.iter().map(|step| step.ns).sum();
        let expected_s = ns * 1e-9 * (words as f64 / TRIAL_WORDS as f64);
        if expected_s > plan.longest_run.as_secs_f64() {
            return Ok(None);
        }
    }
    let Some(mut frame) = frame_of(bench, words)? else { return Ok(None) };
    let ms = || Ok(Bench::run(&mut frame)?.iter().map(|step| step.ns).sum::<f64>() * 1e-6);
    Ok(Some(median(within(plan, ms)?)))
}

/// As many runs as there is time for, three at least, after one that counts only if it takes all of it.
fn within<T>(
    plan: &Plan,
    mut run: impl FnMut() -> Result<T, GpuError>,
) -> Result<Vec<T>, GpuError> {
    let started = Instant::now();
    let first = run()?;
    if started.elapsed() >= plan.time {
        return Ok(vec![first]);
    }
    repeated(plan.time, 3, run).into_iter().collect()
}

/// All pairs by the paper's mapping, one byte or one bit a pair (Avril et al. 2012, table 5, figures 3 and 4).
#[derive(Clone, Debug, PartialEq)]
pub struct MaskRun {
    /// Median times of the upload of the boxes, of the kernel, and of the transfer back, in ms.
    pub ms: [f64; 3],
    pub input_bytes: u64,
    pub output_bytes: u64,
    pub words: Vec<u32>,
}

/// All pairs of `boxes`, so many bits a pair, measured; `None` where they do not fit the device. One thread computes
/// a pair and ORs it in, as in the paper, or a whole word.
pub fn mask(
    bench: &mut Bench,
    bits: u32,
    thread_a_pair: bool,
    boxes: &[Aabb],
    plan: &Plan,
) -> Result<Option<MaskRun>, GpuError> {
    let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
    let pairs = n.pair_count();
    let words = pairs.div_ceil(u64::from(32 / bits));
    let (file, threads) = if thread_a_pair { (MASK_OR, pairs) } else { (MASK, words) };
    let (Some(groups), Ok(pair_count)) = (bench.groups(threads), u32::try_from(pairs)) else {
        return Ok(None);
    };
    let keys: Vec<[[i32; 3]; 2]> =
        boxes.iter().map(KeyBox::from).map(|KeyBox { min, max }| [min, max]).collect();
    let (input_bytes, output_bytes) = (size_of_val(keys.as_slice()) as u64, words * 4);
    let (staged, video_keys) =
        (bench.block(Home::Host, input_bytes)?, bench.block(Home::Video, input_bytes)?);
    staged.write(0, cast_slice::<_, i32>(&keys));
    let (video_out, back) =
        (bench.block(Home::Video, output_bytes)?, bench.block(Home::Host, output_bytes)?);
    let params = [n.get(), pair_count, threads as u32, groups[0]];
    let copy = |from: &Arc<Block>, to| Command::Copy {
        from: Part::of(from, 0, from.bytes()),
        to: Part::of(to, 0, from.bytes()),
    };
    let stage = MappingStage::Mask(file, bits);
    let kernel = bench.command(stage, &[&video_keys, &video_out], &params, groups)?;
    let clear = Command::Fill { part: Part::whole(&video_out), word: 0 };
    let steps = vec![clear, copy(&staged, &video_keys), kernel, copy(&video_out, &back)];
    let mut frame = bench.frame(steps)?;
    let runs = within(plan, || {
        let steps = Bench::run(&mut frame)?;
        Ok([1, 2, 3].map(|step: usize| steps.get(step).map_or(f64::NAN, |step| step.ns * 1e-6)))
    })?;
    let ms = std::array::from_fn(|part| median(runs.iter().map(|run| run[part]).collect()));
    let mut words = vec![0u32; words as usize];
    back.read(0, &mut words);
    Ok(Some(MaskRun { ms, input_bytes, output_bytes, words }))
}
