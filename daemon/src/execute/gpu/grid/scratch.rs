//! Blocks that the grid's stages hand each other, grown as scenes grow.

use std::sync::Arc;

use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::{GridLayout, GridSummary, GridTotals};

use super::plan::{Capacity, Sizes};
use crate::execute::gpu::device::Gpu;
use crate::execute::gpu::error::GpuError;
use crate::execute::gpu::growing::Growing;
use crate::execute::gpu::memory::{Block, Home};

/// Bytes of the levels.
const LAYOUT_BYTES: u64 = size_of::<GridLayout>() as u64;

/// All blocks between the stages.
pub(super) struct Scratch {
    layout: Growing,
    table: Growing,
    control: Growing,
    records: Growing,
    ids: Growing,
    sorted: Growing,
    totals: Growing,
    invalid: Growing,
    found: Growing,
    summary: Growing,
}

/// The blocks of one frame.
#[derive(Clone)]
pub(super) struct Blocks {
    /// The levels, which the CPU writes.
    pub(super) layout: Arc<Block>,
    pub(super) table: Arc<Block>,
    pub(super) control: Arc<Block>,
    pub(super) records: Arc<Block>,
    pub(super) ids: Arc<Block>,
    pub(super) sorted: Arc<Block>,
    pub(super) totals: Arc<Block>,
    pub(super) invalid: Arc<Block>,
    pub(super) found: Arc<Block>,
    pub(super) summary: Arc<Block>,
}

impl Blocks {
    /// All of them.
    pub(super) fn all(&self) -> [&Arc<Block>; 10] {
        let Self { layout, table, control, records, ids, sorted, .. } = self;
        let Self { totals, invalid, found, summary, .. } = self;
        [layout, table, control, records, ids, sorted, totals, invalid, found, summary]
    }
}

impl Scratch {
    pub(super) fn new(gpu: &Gpu) -> Self {
        // Written by the CPU each frame: into video memory where it can, else read from afar.
        let mapped = gpu.limits().mapped_video_memory;
        Self {
            layout: Growing::new(if mapped { Home::MappedVideo } else { Home::Host }),
            table: Growing::new(Home::Video),
            control: Growing::new(Home::Video),
            records: Growing::new(Home::Video),
            ids: Growing::new(Home::Video),
            sorted: Growing::new(Home::Video),
            totals: Growing::new(Home::Video),
            invalid: Growing::new(Home::Host),
            found: Growing::new(Home::Video),
            summary: Growing::new(Home::Host),
        }
    }

    /// Blocks for a frame. `replaced` is set if one is new, `unclean` if one that must be zero
    /// between frames is.
    pub(super) fn blocks(
        &mut self,
        gpu: &Arc<Gpu>,
        sizes: &Sizes,
        capacity: Capacity,
        replaced: &mut bool,
        unclean: &mut bool,
    ) -> Result<Blocks, GpuError> {
        let (n, batches) = (u64::from(sizes.plane()), u64::from(sizes.batches));
        let block = |growing: &mut Growing, bytes, made: &mut bool| {
            growing.at_least(gpu, bytes, made).map(Arc::clone)
        };
        let table = block(&mut self.table, sizes.table_bytes(), unclean)?;
        let control = block(&mut self.control, sizes.control_bytes(), unclean)?;
        *replaced |= *unclean;
        let mut block = |growing: &mut Growing, bytes| block(growing, bytes, replaced);
        Ok(Blocks {
            layout: block(&mut self.layout, LAYOUT_BYTES)?,
            table,
            control,
            records: block(&mut self.records, sizes.records_bytes())?,
            ids: block(&mut self.ids, 4 * n)?,
            sorted: block(&mut self.sorted, sizes.records_bytes())?,
            totals: block(&mut self.totals, batches * size_of::<GridTotals>() as u64)?,
            invalid: block(&mut self.invalid, batches * u64::from(BATCH_BOXES) / 8)?,
            found: block(&mut self.found, capacity.found_bytes())?,
            summary: block(&mut self.summary, size_of::<GridSummary>() as u64)?,
        })
    }
}
