//! The stages of a frame with what they bind.

use std::sync::Arc;

use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::{GridLayout, GridSummary, GridTotals};
use pairmask_shaders::{Found, GridStage, Rules, Stage};

use super::plan::{Capacity, Sizes};
use super::ruled::RuleBlocks;
use crate::execute::gpu::device::Gpu;
use crate::execute::gpu::error::GpuError;
use crate::execute::gpu::frame::Command;
use crate::execute::gpu::memory::{Block, Growing, Home, Part};
use crate::execute::gpu::pipeline::Pipelines;
use crate::execute::gpu::transfers::PlacedBoxes;

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
        stages.into_iter().map(|stage| self.step(pipelines, stage)).collect()
    }

    fn step(&self, pipelines: &mut Pipelines, stage: GridStage) -> Result<Command, GpuError> {
        let b = self.blocks;
        let found = || Part::of(&b.found, 0, self.capacity.found_bytes());
        let (mut parts, groups) = match stage {
            GridStage::Cells(..) | GridStage::SphereCells => (
                vec![
                    self.boxes.part.clone(),
                    Part::whole(&b.layout),
                    self.table(),
                    Part::whole(&b.control),
                    self.records(&b.records),
                    Part::whole(&b.totals),
                    Part::whole(&b.invalid),
                ],
                self.sizes.batches,
            ),
            GridStage::Scan => (
                vec![Part::whole(&b.layout), self.table(), Part::whole(&b.control)],
                self.sizes.sums,
            ),
            GridStage::Scatter => {
                (vec![self.records(&b.records), self.table(), self.ids()], self.sizes.batches)
            }
            GridStage::Place => (
                vec![
                    self.records(&b.records),
                    self.table(),
                    self.ids(),
                    Part::whole(&b.control),
                    self.records(&b.sorted),
                ],
                self.sizes.batches,
            ),
            GridStage::Pairs(what, _) | GridStage::SpherePairs(what) => {
                let mut parts = vec![
                    Part::whole(&b.layout),
                    self.table(),
                    self.records(&b.sorted),
                    Part::whole(&b.totals),
                    Part::whole(&b.control),
                    found(),
                ];
                if what == Found::Words {
                    // The order goes down.
                    parts.push(self.reply.clone());
                }
                (parts, self.sizes.batches)
            }
            GridStage::Write(..) => (
                vec![
                    Part::whole(&b.layout),
                    self.table(),
                    Part::whole(&b.totals),
                    Part::whole(&b.control),
                    found(),
                    self.reply.clone(),
                    Part::whole(&b.summary),
                ],
                self.sizes.batches,
            ),
        };
        if let Some(rules) = self.rules {
            parts.extend(rules.parts(stage));
        }
        let params = self.sizes.params(self.capacity, self.thread_rounds);
        Ok(Command::Stage {
            pipeline: pipelines.get(Stage::Grid(stage))?,
            parts,
            immediates: bytemuck::bytes_of(&params).to_vec(),
            groups: [groups, 1],
        })
    }

    // Not all of their blocks: those have room to spare, which may be more than one binding shows.

    fn table(&self) -> Part {
        Part::of(&self.blocks.table, 0, self.sizes.table_bytes())
    }

    fn records(&self, block: &Arc<Block>) -> Part {
        Part::of(block, 0, self.sizes.records_bytes())
    }

    fn ids(&self) -> Part {
        Part::of(&self.blocks.ids, 0, 4 * u64::from(self.sizes.plane()))
    }
}

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
