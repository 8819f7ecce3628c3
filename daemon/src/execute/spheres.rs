//! Spheres: on the GPU where it is sooner done, else on the CPU. Both decide them exactly.

use std::sync::Arc;
use std::time::Instant;

use pairmask_core::aabb::AABB_BYTES;
use pairmask_core::dispatch::{CullAnswer, CullOptions, SphereWays, nanoseconds_since};
use pairmask_core::engine::{CullError, ReplyBuffer};
use pairmask_core::objects::Objects;
use pairmask_core::plan::{GpuCost, Plan, SceneStats};
use pairmask_core::sphere::SPHERE_BYTES;
use pairmask_core::{BoxCount, EngineChoice, EngineName, Sphere};

use super::frame_memory::FrameMemory;
use super::{Executor, Frame, Owner, SharedGpu, is_left_to_cores, offering_reply};

/// Scratch that a frame takes, bytes a sphere: its bounds and its ball, 24 and 32, or four columns and
/// the order, 36.
const SPHERE_SCRATCH_BYTES: usize = 64;
/// Scratch that a frame takes, bytes a pair: a word each, at the most.
const PAIR_SCRATCH_BYTES: usize = 12;

/// Most spheres that all pairs takes. Pairs that are near in all digits take a thousand times as long as others
/// (0.55 s here on an H200), and nobody else has the GPU meanwhile.
const ALL_PAIRS_SPHERES: usize = 32_768;
/// Most spheres that all pairs takes on a software adapter, where no other engine decides any. lavapipe ends all
/// loops of a thread after 65,535 rounds together, silently, and a near pair takes up to 753 (`GPU.md`,
/// "Spheres"): a thread has four rows, so 4 · 15 · 753 here.
const SOFTWARE_SPHERES: usize = 16;

pub(super) fn takes_spheres(engine: EngineName, spheres: usize, is_software: bool) -> bool {
    match engine {
        EngineName::GpuBrute if is_software => spheres <= SOFTWARE_SPHERES,
        EngineName::GpuBrute => spheres <= ALL_PAIRS_SPHERES,
        _ => !is_software,
    }
}

impl Executor {
    /// Finds the pairs of the spheres of this memory, which belong to `owner`, as [`Self::cull_spheres`].
    pub fn run_spheres<M: FrameMemory>(
        &mut self,
        owner: Owner,
        options: &CullOptions,
        memory: &mut M,
    ) -> Result<CullAnswer, CullError> {
        let gpu = self.gpus.for_frame(self.home).cloned();
        offering_reply(gpu.as_ref(), memory, |objects, reply| match objects {
            Objects::Spheres(spheres) => self.cull_spheres(spheres, owner, options, reply),
            Objects::Boxes(boxes) => self.cull(boxes, owner, options, reply),
        })
    }

    /// Finds the pairs of spheres that belong to `owner`, on a GPU or on cores as [`Self::cull`].
    pub fn cull_spheres(
        &mut self,
        spheres: &[Sphere],
        owner: Owner,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.last_frame = Some(Instant::now());
        let (len, limit_words) = (spheres.len(), reply.limit_words());
        let options = options.within(len, limit_words);
        let start = Instant::now();
        let Some((gpu, plan)) = self.gpu_plan(len, &options) else {
            return self.cull_spheres_here(spheres, &options, reply);
        };
        log::debug!("{}", plan.explain());
        let plan_ns = nanoseconds_since(start);
        let mut frame = Frame { objects: spheres.into(), owner, reply };
        let error = match frame.cull_on(&gpu, &plan) {
            Ok((report, engine)) => {
                return Ok(CullAnswer::new(&Plan { engine, ..plan }, report, start, plan_ns));
            }
            Err(error) => error,
        };
        if is_left_to_cores(&error) {
            let here = CullOptions { engine: EngineChoice::Auto, ..options };
            return self.cull_spheres_here(spheres, &here, reply);
        }
        // It names its encoding, so that there is no third time.
        let other = options.after(plan.encoding, &error, len, limit_words).ok_or(error)?;
        self.cull_spheres(spheres, owner, &other, reply)
    }

    /// The plan of a frame of so many spheres that goes to the GPU; `None` for one that does not: also where
    /// an engine of the GPU is asked for that does not take so many on this adapter.
    ///
    /// The spheres are not looked at. The GPU gets what it does sooner than the CPU would cull as many
    /// boxes at best, which it culls in less time than spheres.
    fn gpu_plan(&self, len: usize, options: &CullOptions) -> Option<(Arc<SharedGpu>, Plan)> {
        let n = BoxCount::of_len(len)?;
        let gpu = self.gpus.for_frame(self.home)?;
        let (is_software, cost) = (gpu.is_software(), gpu.cost());
        let may = match options.engine {
            EngineChoice::Only(engine) => engine.is_gpu(),
            EngineChoice::Auto => cost.is_some(),
        };
        if !may {
            return None;
        }
        // Boxes up take the time of their bytes; spheres have fewer.
        let share = SPHERE_BYTES as f64 / AABB_BYTES as f64;
        let cost = cost.map(|cost| GpuCost { ns_a_box: share * cost.ns_a_box, ..cost });
        let plan = self.plan_unseen(&SceneStats::at_best(n, options.last_pairs), cost, options);
        let is_taken = plan.engine.is_gpu() && takes_spheres(plan.engine, len, is_software);
        is_taken.then(|| (Arc::clone(gpu), plan))
    }

    fn cull_spheres_here(
        &mut self,
        spheres: &[Sphere],
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let answer = self.spheres.cull(&mut self.cpu.engines, spheres, options, reply);
        let pairs = answer.as_ref().map_or(0, |answer| answer.report.pair_count);
        let needed = SPHERE_SCRATCH_BYTES * spheres.len() + PAIR_SCRATCH_BYTES * pairs as usize;
        if self.spheres_need.note(needed, || self.spheres.scratch_bytes()) {
            self.spheres = SphereWays::default();
        }
        answer
    }
}
