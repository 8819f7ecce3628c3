//! Engines of the daemon: those of the client library, and the GPU.

pub mod gpu;

use pairmask::Aabb;
use pairmask::engine::{CpuEngines, CullAnswer, CullError, CullWish, ReplyBuffer};

/// All engines that this daemon has.
pub struct Executor {
    cpu: CpuEngines,
}

impl Default for Executor {
    fn default() -> Self {
        Self::new()
    }
}

impl Executor {
    /// The CPU engines.
    pub fn new() -> Self {
        Self { cpu: CpuEngines::new() }
    }

    /// Plans a frame and finds its pairs.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.cpu.cull(boxes, wish, reply)
    }
}
