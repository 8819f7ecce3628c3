//! Spheres: always the engines of the CPU.
//!
//! A GPU could look for candidates among the spheres' bounds, but its mask would have to come into
//! memory of the daemon's own that stays where it is, and the exact test, which is most of the work,
//! would still be the CPU's.

use std::time::Instant;

use pairmask_core::Sphere;
use pairmask_core::dispatch::{CullAnswer, CullOptions, SphereWays};
use pairmask_core::engine::{CullError, ReplyBuffer};

use super::Executor;

/// Scratch that a frame takes, bytes a sphere: its bounds and its ball, 24 and 32, or four columns and
/// the order, 36.
const SPHERE_SCRATCH_BYTES: usize = 64;
/// Scratch that a frame takes, bytes a pair: a word each, at the most.
const PAIR_SCRATCH_BYTES: usize = 12;

impl Executor {
    /// Finds the pairs of spheres.
    ///
    /// # Errors
    /// [`CullError`]; [`CullError::Unavailable`] where an engine of the GPU is asked for.
    pub fn cull_spheres(
        &mut self,
        spheres: &[Sphere],
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.last_frame = Some(Instant::now());
        let answer = self.spheres.cull(&mut self.cpu.engines, spheres, options, reply);
        let pairs = answer.as_ref().map_or(0, |answer| answer.report.pair_count);
        let needed = SPHERE_SCRATCH_BYTES * spheres.len() + PAIR_SCRATCH_BYTES * pairs as usize;
        if self.spheres_need.note(needed, || self.spheres.scratch_bytes()) {
            self.spheres = SphereWays::default();
        }
        answer
    }
}
