//! The stages of a frame with what they bind.

use std::sync::Arc;

use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::{GridLayout, GridSummary, GridTotals};
use pairmask_shaders::{GridStage, Rules, Stage};

use super::ruled::RuleBlocks;
use super::workspace::{Tools, Uploaded};
use crate::execute::gpu::{
    Capacity, Command, Gpu, GpuError, Growing, Home, Part, Sizes, frame_blocks,
};

impl Uploaded {
    pub(super) fn steps(&self, tools: &mut Tools) -> Result<Vec<Command>, GpuError> {
        let (boxes, sizes) = (self.read(), Sizes::of(self.n));
        let rules = if self.rules.is_some() { Rules::With } else { Rules::Without };
        let stages = GridStage::of_frame(boxes.form, self.capacity.found, rules);
        let mut parts = self.blocks.named();
        parts.extend([("boxes", &boxes.part), ("reply", &self.mask.part)]);
        parts.extend(self.rules.iter().flat_map(RuleBlocks::named));
        let params = sizes.params(self.capacity, tools.gpu.limits().thread_rounds);
        let pipelines = &mut tools.pipelines;
        let step = |stage: GridStage| {
            let groups = if stage == GridStage::Scan { sizes.sums } else { sizes.batches };
            Command::stage(pipelines.get(Stage::Grid(stage))?, &parts, &params, [groups, 1])
        };
        stages.into_iter().map(step).collect()
    }
}

const LAYOUT_BYTES: u64 = size_of::<GridLayout>() as u64;

frame_blocks! { Scratch, Blocks:
    grid in Host,
    table in Video,
    control in Video,
    records in Video,
    ids in Video,
    sorted in Video,
    totals in Video,
    invalid in Host,
    found in Video,
    summary in Host,
}

impl Scratch {
    pub(super) fn on(gpu: &Gpu) -> Self {
        Self { grid: Growing::new(Home::written(gpu)), ..Self::new() }
    }

    /// `replaced` is set if a block is new, `unclean` if one is that must be zero between frames.
    pub(super) fn blocks(
        &mut self,
        gpu: &Arc<Gpu>,
        sizes: &Sizes,
        capacity: Capacity,
        replaced: &mut bool,
        unclean: &mut bool,
    ) -> Result<Blocks, GpuError> {
        let (n, batches) = (u64::from(sizes.plane()), u64::from(sizes.batches));
        let table = self.table.part(gpu, sizes.table_bytes(), unclean)?;
        let control = self.control.part(gpu, sizes.control_bytes(), unclean)?;
        *replaced |= *unclean;
        let mut part = |growing: &mut Growing, bytes| growing.part(gpu, bytes, replaced);
        Ok(Blocks {
            grid: part(&mut self.grid, LAYOUT_BYTES)?,
            table,
            control,
            records: part(&mut self.records, sizes.records_bytes())?,
            ids: part(&mut self.ids, 4 * n)?,
            sorted: part(&mut self.sorted, sizes.records_bytes())?,
            totals: part(&mut self.totals, batches * size_of::<GridTotals>() as u64)?,
            invalid: part(&mut self.invalid, batches * u64::from(BATCH_BOXES) / 8)?,
            found: part(&mut self.found, capacity.found_bytes())?,
            summary: part(&mut self.summary, size_of::<GridSummary>() as u64)?,
        })
    }
}
