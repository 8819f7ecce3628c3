//! Times of persistent scenes in video memory: an edit by the host's clock, and its stages by the GPU's.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask_core::Aabb;
use pairmask_core::aabb::KeyBox;
use pairmask_core::scene::{
    Edit, Indices, QueryFilterData, Report, Reported, Scene, SceneOptions, Sets, Step,
};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{
    Awake, EngineOptions, Gpu, GpuScene, SceneTools, StepTime, user_cache_folder,
};
use pairmaskd::scene::{Random, SceneName};

use super::wrong_pairs;
use crate::Result;
use crate::study::harness::{Fields, median, percentile, row};
use crate::study::moving::{Motion, World};

/// Edits that are not counted: memory is taken, layouts are chosen, frames are recorded.
const WARM_UP: usize = 6;
/// Edits whose stages are timed: timestamps cost about a microsecond a stage.
const TIMED_STAGES: usize = 20;
const CHECKED_QUERIES: usize = 100;
/// How long the clocks are kept up between edits, while the next one is made.
const HOLD: Duration = Duration::from_secs(5);

#[derive(Clone, Copy, Debug, Args)]
pub struct Effort {
    /// Edits of each line
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "100")]
    frames: NonZeroU32,
    /// Boxes that are asked for after each edit
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 10_000)]
    queries: u32,
    /// Take times of stages too, by the GPU's clock
    #[arg(long)]
    stages: bool,
    /// Do not compare with the CPU's pairs
    #[arg(long)]
    unchecked: bool,
}

#[derive(Clone, Copy, Debug)]
pub struct Case {
    pub scene: SceneName,
    pub motion: Motion,
    /// How many of a hundred move in each edit.
    pub percent: f64,
    pub effort: Effort,
}

/// Pairs, as a number and a sum of hashes that depends on no order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PairSum {
    count: u64,
    sum: u64,
}

impl PairSum {
    fn of(pairs: &[[u32; 2]]) -> Self {
        let mut sum = Self::default();
        for pair in pairs {
            sum.add(*pair);
        }
        sum
    }

    pub(crate) fn add(&mut self, pair: [u32; 2]) {
        self.count += 1;
        self.sum = self.sum.wrapping_add(mixed(pair));
    }

    fn take(&mut self, reported: &Reported) {
        if reported.is_resync() {
            *self = Self::of(reported.pairs());
            return;
        }
        for pair in reported.begun() {
            self.add(*pair);
        }
        for ended in reported.ended() {
            self.count = self.count.wrapping_sub(1);
            self.sum = self.sum.wrapping_sub(mixed(ended.pair));
        }
    }
}

fn mixed([a, b]: [u32; 2]) -> u64 {
    Random::new(u64::from(a) << 32 | u64::from(b)).bits()
}

/// What an edit or queries took.
struct Times {
    us: f64,
    submissions: u32,
    stages: Vec<StepTime>,
}

/// A scene on some devices, and times of edits and of the queries after each.
struct Run {
    scene: GpuScene,
    known: PairSum,
    edits: Vec<Times>,
    asked: Vec<Times>,
    queries: Vec<Aabb>,
    found: Vec<[u32; 2]>,
}

impl Run {
    fn new(
        gpus: &[Arc<Gpu>],
        world: &mut World,
        case: &Case,
        frames: usize,
        profiled: bool,
    ) -> Result<Self> {
        let awake =
            gpus.iter().map(|gpu| Awake::start(gpu, HOLD)).collect::<Result<Vec<_>, _>>()?;
        let n = world.boxes().len();
        let mut tools = Vec::with_capacity(gpus.len());
        for gpu in gpus {
            let options = EngineOptions {
                profiled,
                cache_folder: user_cache_folder(),
                ..EngineOptions::default()
            };
            tools.push(SceneTools::new(gpu, &options)?);
        }
        let mut run = Self {
            scene: GpuScene::shared(&tools, SceneOptions::default()),
            known: PairSum::default(),
            edits: Vec::new(),
            asked: Vec::new(),
            queries: queries(world.boxes(), case.effort.queries as usize),
            found: Vec::new(),
        };
        let all: Vec<u32> = (0..n as u32).collect();
        run.edit(&all, world.boxes(), false)?;
        let moving = (n as f64 * case.percent / 100.0).round() as usize;
        for frame in 0..frames + WARM_UP {
            for awake in awake.iter().flatten() {
                awake.note_frame();
            }
            let (indices, boxes) = world.step(moving, case.motion);
            let edit = run.edit(&indices, &boxes, case.motion == Motion::Spawn)?;
            let asked = (!run.queries.is_empty()).then(|| run.ask()).transpose()?;
            if frame >= WARM_UP {
                run.edits.push(edit);
                run.asked.extend(asked);
            }
        }
        Ok(run)
    }

    fn edit(&mut self, indices: &[u32], boxes: &[Aabb], is_spawn: bool) -> Result<Times> {
        let is_all = !indices.is_empty() && indices.len() == self.scene.len();
        let these = if is_all { (0..indices.len() as u32).into() } else { Indices::List(indices) };
        let both = [Step::Remove(these), Step::Set(Sets { indices: these, boxes })];
        let steps = if is_spawn { &both[..] } else { &both[1..] };
        let steps = if indices.is_empty() { &[] } else { steps };
        let start = Instant::now();
        let reported = self.scene.edit(Edit { steps }, Report::Changes)?;
        let took = start.elapsed();
        self.known.take(reported);
        self.scene.acknowledge();
        Ok(self.times(took))
    }

    fn times(&self, took: Duration) -> Times {
        let us = took.as_secs_f64() * 1e6;
        let (submissions, stages) = (self.scene.submissions(), self.scene.stages().to_vec());
        Times { us, submissions, stages }
    }

    fn ask(&mut self) -> Result<Times> {
        let start = Instant::now();
        self.scene.query(&self.queries, QueryFilterData::None, &mut self.found)?;
        let took = start.elapsed();
        Ok(self.times(took))
    }
}

fn whole(times: &[Times], percent: usize) -> f64 {
    percentile(times.iter().map(|times| times.us).collect(), percent)
}

fn stages(times: &[Times]) -> BTreeMap<&'static str, f64> {
    let mut stages: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    for step in times.iter().flat_map(|times| &times.stages) {
        stages.entry(step.label).or_default().push(step.ns / 1e3);
    }
    stages.into_iter().map(|(label, us)| (label, median(us))).collect()
}

pub fn measure(gpus: &[Arc<Gpu>], world: &mut World, case: &Case) -> Result<Fields> {
    let effort = &case.effort;
    let run = Run::new(gpus, world, case, effort.frames.get() as usize, false)?;
    let n = world.boxes().len();
    if !effort.unchecked {
        let mut fresh = Scene::new(SceneOptions::default());
        let sets = Sets { indices: (0..n as u32).into(), boxes: world.boxes() };
        let all = fresh.edit(Edit { steps: &[Step::Set(sets)] }, Report::All)?;
        let is_right = PairSum::of(all.pairs()) == run.known;
        if !(is_right && are_found(world.boxes(), &run.queries, &run.found)) {
            return Err(wrong_pairs(n as u32, case.scene));
        }
    }
    let Run { scene, known, edits, asked, queries, found, .. } = run;
    let reported = scene.reported();
    let [stage_us, query_stage_us] = if effort.stages {
        let timed = Run::new(gpus, &mut world.clone(), case, TIMED_STAGES, true)?;
        [stages(&timed.edits), stages(&timed.asked)]
    } else {
        Default::default()
    };
    Ok(row!(
        scene: case.scene.to_string(),
        n,
        moving: case.percent / 100.0,
        motion: case.motion.name(),
        edit_us: whole(&edits, 50),
        edit_p99_us: whole(&edits, 99),
        submissions: edits.iter().map(|times| times.submissions).max().unwrap_or(0),
        repeated: edits.iter().filter(|times| times.submissions > 1).count(),
        changes: reported.begun().len() + reported.ended().len(),
        tested: reported.skipped().tested,
        pairs: known.count,
        queries: queries.len(),
        query_us: [1, 50, 99].map(|percent| whole(&asked, percent)),
        query_pairs: found.len(),
        query_stage_us,
        video_bytes_a_box: scene.video_bytes() as f64 / n.max(1) as f64,
        stage_us,
        checked: !effort.unchecked,
    ))
}

/// Queries among the boxes of a scene: some of them, moved by a third of their size.
fn queries(boxes: &[Aabb], count: usize) -> Vec<Aabb> {
    let count = if boxes.is_empty() { 0 } else { count };
    let moved = |i: usize| {
        let b = boxes[i * boxes.len() / count];
        let shift: [f32; 3] = std::array::from_fn(|axis| (b.max[axis] - b.min[axis]) / 3.0);
        let by = |x: [f32; 3]| std::array::from_fn(|axis| x[axis] + shift[axis]);
        Aabb { min: by(b.min), max: by(b.max) }
    };
    (0..count).map(moved).collect()
}

/// Whether the pairs that some queries found are right.
fn are_found(boxes: &[Aabb], queries: &[Aabb], found: &[[u32; 2]]) -> bool {
    let keys =
        |boxes: &[Aabb]| -> Vec<KeyBox> { boxes.iter().map(|b| KeyBox::classify(b).0).collect() };
    let (boxes, queries) = (keys(boxes), keys(queries));
    let step = (queries.len() / CHECKED_QUERIES).max(1);
    queries.iter().enumerate().step_by(step).all(|(number, query)| {
        let start = found.partition_point(|pair| (pair[0] as usize) < number);
        let end = found.partition_point(|pair| pair[0] as usize <= number);
        let overlapped = boxes.iter().enumerate().filter(|(_, b)| b.overlaps(query));
        overlapped.map(|(index, _)| index as u32).eq(found[start..end].iter().map(|p| p[1]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_pairs_notices_what_is_missing_and_what_is_twice() {
        let pairs = [[0, 1], [0, 2], [1, 7]];
        let sum = PairSum::of(&pairs);
        assert_eq!(sum, PairSum::of(&[[1, 7], [0, 1], [0, 2]]));
        assert_ne!(sum, PairSum::of(&pairs[1..]));
        assert_ne!(sum, PairSum::of(&[[0, 1], [0, 2], [0, 2]]));
        let mut known = PairSum::default();
        known.take(&Reported::of_changes(pairs.to_vec(), Vec::new(), 3));
        assert_eq!(known, sum);
    }
}
