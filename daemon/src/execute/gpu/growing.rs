//! Blocks that grow with the scenes.

use std::sync::Arc;

use pairmask_core::engine::RecentNeed;

use super::device::Gpu;
use super::error::GpuError;
use super::memory::{Block, Home};

/// A block that is made anew, larger, when more is asked of it, and smaller when much less is for some
/// dozens of frames.
pub(super) struct Growing {
    home: Home,
    block: Option<Arc<Block>>,
    need: RecentNeed,
}

impl Growing {
    pub(super) const fn new(home: Home) -> Self {
        Self { home, block: None, need: RecentNeed::NONE }
    }

    /// A block of at least `bytes`. `replaced` is set if it is not the one of last time.
    pub(super) fn at_least(
        &mut self,
        gpu: &Arc<Gpu>,
        bytes: u64,
        replaced: &mut bool,
    ) -> Result<&Arc<Block>, GpuError> {
        let held = self.block.as_ref().map_or(0, |block| block.bytes());
        let is_needed = !self.need.note(bytes as usize, || held as usize);
        let kept = self.block.take().filter(|block| is_needed && block.bytes() >= bytes);
        let block = if let Some(block) = kept {
            block
        } else {
            *replaced = true;
            // A quarter more, so that a slowly growing scene does not allocate each frame; the
            // bare size when that is too much.
            let roomy = Block::new(gpu, self.home, bytes + bytes / 4);
            roomy.or_else(|_| Block::new(gpu, self.home, bytes))?
        };
        Ok(self.block.insert(block))
    }
}
