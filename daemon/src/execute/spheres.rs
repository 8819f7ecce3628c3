//! Spheres: always the engines of the CPU.
//!
//! A GPU could look for candidates among the spheres' bounds, but its mask would have to come into
//! memory of the daemon's own that stays where it is, and the exact test, which is most of the work,
//! would still be the CPU's.

use pairmask::Sphere;
use pairmask::engine::{CullAnswer, CullError, CullWish, ReplyBuffer};

use super::Executor;

impl Executor {
    /// Finds the pairs of spheres.
    ///
    /// # Errors
    /// [`CullError`]; [`CullError::Unavailable`] where an engine of the GPU is asked for.
    pub fn cull_spheres(
        &mut self,
        spheres: &[Sphere],
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.spheres.cull(&mut self.cpu.engines, spheres, wish, reply)
    }
}
