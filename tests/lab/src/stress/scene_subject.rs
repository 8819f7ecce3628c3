//! Scenes that persist under stress: from other boxes to those of the case, by edits of all kinds.
//!
//! A case's seed determines the whole way. Answers are taken or dropped by chance. What was taken adds up to
//! the oracle's pairs at the end, each change told once.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::CullError;
use pairmask_core::oracle::Pair;
use pairmask_core::scene::{Edit, Scene, SceneError, SceneOptions, Sets, Step, Told, Want};
use pairmaskd::execute::gpu::{GpuScene, SceneTools};
use pairmaskd::scene::Random;
use rayon::ThreadPool;

use super::case::Case;
use super::scene_edits::KnownPairs;
use super::subject::{Finding, Outcome, Subject, compare};

/// Makes the random numbers of edits independent of those of boxes.
const STREAM: u64 = 0x5343_454e_4553;

/// Who keeps the scenes.
enum Keeper {
    Cores,
    Gpu(Arc<SceneTools>),
}

/// A scene of a case.
#[allow(clippy::large_enum_variant)] // One at a time.
enum Kept {
    Cores(Scene),
    Gpu(GpuScene),
}

impl Kept {
    fn edit(&mut self, steps: &[Step<'_>], want: Want) -> Result<&Told, SceneError> {
        match self {
            Self::Cores(scene) => scene.edit(Edit { steps }, want),
            Self::Gpu(scene) => scene.edit(Edit { steps }, want),
        }
    }

    fn take(&mut self) {
        match self {
            Self::Cores(scene) => scene.take(),
            Self::Gpu(scene) => scene.take(),
        }
    }
}

/// Scenes that are kept by the threads of a pool, or by a GPU.
pub struct SceneSubject {
    name: String,
    pool: Arc<ThreadPool>,
    keeper: Keeper,
    broken: bool,
}

impl SceneSubject {
    /// Scenes of the cores. With `broken` a pair is lost, to test that the checks notice.
    pub fn new(pool: &Arc<ThreadPool>, broken: bool) -> Self {
        let threads = pool.current_num_threads();
        let plural = if threads == 1 { "" } else { "s" };
        let name = format!("scene, {threads} thread{plural}");
        Self { name, pool: Arc::clone(pool), keeper: Keeper::Cores, broken }
    }

    /// Scenes in video memory.
    pub fn on_gpu(tools: Arc<SceneTools>, pool: &Arc<ThreadPool>, broken: bool) -> Self {
        let name = format!("scene on {}", tools.gpu().info().name);
        Self { name, pool: Arc::clone(pool), keeper: Keeper::Gpu(tools), broken }
    }

    /// The way to the case's boxes. `None` where the GPU left the scene to the cores.
    fn known(&self, case: &Case) -> Result<Option<KnownPairs>, Finding> {
        let options = SceneOptions::default();
        let mut scene = match &self.keeper {
            Keeper::Cores => Kept::Cores(Scene::new(options)),
            Keeper::Gpu(tools) => Kept::Gpu(GpuScene::new(tools, options)),
        };
        let mut known = KnownPairs::default();
        let mut random = Random::new(case.seed ^ STREAM);
        let way = Way::new(&case.boxes, &mut random);
        for round in 0..way.rounds {
            let steps = way.steps(round, &mut random);
            let is_last = round + 1 == way.rounds;
            let want = if is_last || random.below(3) > 0 {
                Want::Changes
            } else {
                [Want::Moved, Want::All, Want::Nothing][random.below(3) as usize]
            };
            let told = match scene.edit(&steps.as_steps(), want) {
                Ok(told) => told,
                Err(SceneError::Cull(CullError::TooCrowded { .. })) => return Ok(None),
                Err(error) => return Err(Finding::other(&error)),
            };
            if !is_last && random.below(3) == 0 {
                continue;
            }
            if told.is_resync() || want == Want::All {
                known.resync(told.pairs().iter().copied());
            } else if want == Want::Changes {
                let (begun, ended) = (told.begun().iter(), told.ended().iter());
                let changed = known.change(begun.copied(), ended.copied());
                changed.map_err(|what| Finding::other(&what))?;
            }
            scene.take();
        }
        Ok(Some(known))
    }
}

impl Subject for SceneSubject {
    fn name(&self) -> &str {
        &self.name
    }

    fn engine(&self) -> &'static str {
        "scenes"
    }

    fn check(&mut self, case: &Case) -> Result<Outcome, Finding> {
        let known = case.flags.install(&self.pool, || self.known(case))?;
        let Some(known) = known else { return Ok(Outcome::Declined) };
        let mut pairs: Vec<Pair> = known.iter().map(|[a, b]| (a, b)).collect();
        if self.broken {
            pairs.pop();
        }
        compare(&pairs, &case.truth.pairs, &case.truth.pairs)?;
        Ok(Outcome::Right)
    }
}

/// Boxes on their way to those of a case.
struct Way {
    /// Boxes of the case, then others that are there meanwhile.
    boxes: Vec<Aabb>,
    /// Boxes of the case.
    n: usize,
    rounds: u64,
}

/// An edit by indices.
#[derive(Default)]
struct Indices {
    removed: Vec<u32>,
    set: Vec<u32>,
    to: Vec<Aabb>,
    off: Vec<u32>,
    on: Vec<u32>,
    statics: Vec<u32>,
    movable: Vec<u32>,
}

impl Indices {
    fn as_steps(&self) -> [Step<'_>; 6] {
        [
            Step::Remove((&self.removed).into()),
            Step::Set(Sets { indices: (&self.set).into(), boxes: &self.to }),
            Step::Switch((&self.off).into(), false),
            Step::Switch((&self.on).into(), true),
            Step::Static((&self.statics).into(), true),
            Step::Static((&self.movable).into(), false),
        ]
    }
}

impl Way {
    fn new(boxes: &[Aabb], random: &mut Random) -> Self {
        let n = boxes.len();
        let others = if n == 0 { 0 } else { random.below(9) as usize };
        let mut all = boxes.to_vec();
        all.extend((0..others).map(|i| boxes[i * 7 % n]));
        Self { boxes: all, n, rounds: 2 + random.below(4) }
    }

    fn steps(&self, round: u64, random: &mut Random) -> Indices {
        let all = 0..self.boxes.len() as u32;
        let mut edit = Indices::default();
        if round + 1 == self.rounds {
            edit.removed = (self.n as u32..all.end).collect();
            edit.set = (0..self.n as u32).collect();
            edit.to = self.boxes[..self.n].to_vec();
            (edit.on, edit.movable) = (edit.set.clone(), edit.set.clone());
            return edit;
        }
        // All at first, then some; most of them go where they shall be, or where others are.
        let one_in = if round == 0 { 1 } else { [1, 4, 40][random.below(3) as usize] };
        for index in all {
            if random.below(one_in) > 0 {
                continue;
            }
            if round > 0 && random.below(30) == 0 {
                edit.removed.push(index);
            }
            let from = match random.below(3) {
                0 => random.below(self.boxes.len() as u64) as usize,
                _ => index as usize,
            };
            edit.set.push(index);
            edit.to.push(self.boxes[from]);
            let flags = match random.below(40) {
                0 => &mut edit.off,
                1 => &mut edit.on,
                2 => &mut edit.statics,
                3 => &mut edit.movable,
                _ => continue,
            };
            flags.push(index);
        }
        edit
    }
}
