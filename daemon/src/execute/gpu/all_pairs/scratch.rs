//! Blocks that the stages hand each other, grown as scenes grow.

use std::sync::Arc;

use pairmask_core::BoxCount;
use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::{BatchReport, BatchTotals};

use super::plan::{Band, plane_words};
use crate::execute::gpu::device::Gpu;
use crate::execute::gpu::error::GpuError;
use crate::execute::gpu::growing::Growing;
use crate::execute::gpu::memory::{Block, Home};

/// All blocks between the stages.
pub(super) struct Scratch {
    keys: Growing,
    totals: Growing,
    matrix: Growing,
    masks: Growing,
    reports: Growing,
}

/// The blocks of one frame.
#[derive(Clone)]
pub(super) struct Stages {
    pub(super) keys: Arc<Block>,
    pub(super) totals: Arc<Block>,
    pub(super) matrix: Arc<Block>,
    pub(super) masks: Arc<Block>,
    pub(super) reports: Arc<Block>,
}

impl Scratch {
    pub(super) const fn new() -> Self {
        Self {
            keys: Growing::new(Home::Video),
            totals: Growing::new(Home::Video),
            matrix: Growing::new(Home::Video),
            masks: Growing::new(Home::Video),
            reports: Growing::new(Home::Host),
        }
    }

    /// Blocks that hold `n` boxes and the largest of `bands`.
    pub(super) fn stages(
        &mut self,
        gpu: &Arc<Gpu>,
        n: BoxCount,
        bands: &[Band],
        replaced: &mut bool,
    ) -> Result<Stages, GpuError> {
        let plane = plane_words(n);
        let batches = plane / u64::from(BATCH_BOXES);
        let most = |words: fn(&Band) -> u64| 4 * bands.iter().map(words).max().unwrap_or(0);
        let matrix = most(Band::matrix_words);
        let masks = most(Band::mask_words);
        let mut block =
            |growing: &mut Growing, bytes| growing.at_least(gpu, bytes, replaced).map(Arc::clone);
        Ok(Stages {
            keys: block(&mut self.keys, 24 * plane)?,
            totals: block(&mut self.totals, batches * size_of::<BatchTotals>() as u64)?,
            matrix: block(&mut self.matrix, matrix)?,
            masks: block(&mut self.masks, masks)?,
            reports: block(&mut self.reports, batches * size_of::<BatchReport>() as u64)?,
        })
    }
}
