//! The stages of a frame with what they bind.

use std::sync::Arc;

use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::{GridLayout, GridSummary, GridTotals};
use pairmask_shaders::{Found, GridStage, Rules, Stage};

use super::ruled::RuleBlocks;
use crate::execute::gpu::{
    Block, Capacity, Command, Gpu, GpuError, Growing, Home, Part, Pipelines, PlacedBoxes, Sizes,
    frame_blocks,
};

/// What the steps of a frame have in common.
pub(super) struct Recording<'a> {
    pub(super) sizes: Sizes,
    pub(super) capacity: Capacity,
    pub(super) blocks: &'a Blocks,
    /// Where the boxes are.
    pub(super) boxes: &'a PlacedBoxes,
    /// Where the reply is.
    pub(super) reply: &'a Part,
    /// The rules of the boxes, if the frame has any.
    pub(super) rules: Option<&'a RuleBlocks>,
    /// Rounds of loops that a thread may take.
    pub(super) thread_rounds: u32,
}

impl Recording<'_> {
    /// All steps, in order.
    pub(super) fn steps(&self, pipelines: &mut Pipelines) -> Result<Vec<Command>, GpuError> {
        let rules = if self.rules.is_some() { Rules::With } else { Rules::Without };
        let stages = GridStage::of_frame(self.boxes.form, self.capacity.found, rules);
        let (b, sizes) = (self.blocks, &self.sizes);
        // Not all of these: they have room to spare, which may be more than one binding shows.
        let table = Part::of(&b.table, 0, sizes.table_bytes());
        let records = Part::of(&b.records, 0, sizes.records_bytes());
        let sorted = Part::of(&b.sorted, 0, sizes.records_bytes());
        let ids = Part::of(&b.ids, 0, 4 * u64::from(sizes.plane()));
        let found = Part::of(&b.found, 0, self.capacity.found_bytes());
        let whole = [&b.layout, &b.control, &b.totals, &b.invalid, &b.summary].map(Part::whole);
        let [layout, control, totals, invalid, summary] = whole;
        let (boxes, reply) = (&self.boxes.part, self.reply);
        let params = sizes.params(self.capacity, self.thread_rounds);
        let step = |stage: GridStage| {
            let parts: &[&Part] = match stage {
                GridStage::Cells(..) | GridStage::SphereCells => {
                    &[boxes, &layout, &table, &control, &records, &totals, &invalid]
                }
                GridStage::Scan => &[&layout, &table, &control],
                GridStage::Scatter => &[&records, &table, &ids],
                GridStage::Place => &[&records, &table, &ids, &control, &sorted],
                GridStage::Pairs(Found::Pairs, _) | GridStage::SpherePairs(Found::Pairs) => {
                    &[&layout, &table, &sorted, &totals, &control, &found]
                }
                // The order goes down.
                GridStage::Pairs(Found::Words, _) | GridStage::SpherePairs(Found::Words) => {
                    &[&layout, &table, &sorted, &totals, &control, &found, reply]
                }
                GridStage::Write(..) => {
                    &[&layout, &table, &totals, &control, &found, reply, &summary]
                }
            };
            let mut parts: Vec<Part> = parts.iter().copied().cloned().collect();
            if let Some(rules) = self.rules {
                parts.extend(rules.parts(stage));
            }
            let groups = if stage == GridStage::Scan { sizes.sums } else { sizes.batches };
            Ok(Command::Stage {
                pipeline: pipelines.get(Stage::Grid(stage))?,
                parts,
                immediates: bytemuck::bytes_of(&params).to_vec(),
                groups: [groups, 1],
            })
        };
        stages.into_iter().map(step).collect()
    }
}

/// Bytes of the levels.
const LAYOUT_BYTES: u64 = size_of::<GridLayout>() as u64;

frame_blocks! { Scratch of Growing, Blocks:
    layout in Host,
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

impl Blocks {
    /// All of them.
    pub(super) fn all(&self) -> impl Iterator<Item = &Arc<Block>> {
        let Self { layout, table, control, records, ids, sorted, .. } = self;
        let Self { totals, invalid, found, summary, .. } = self;
        [layout, table, control, records, ids, sorted, totals, invalid, found, summary].into_iter()
    }
}

impl Scratch {
    pub(super) fn on(gpu: &Gpu) -> Self {
        Self { layout: Growing::new(Home::written(gpu)), ..Self::new() }
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
