//! The stages of a frame with what they bind.

use std::sync::Arc;

use pairmask_shaders::{Found, GridStage, Rules, Stage};

use super::plan::{Capacity, Sizes};
use super::ruled::RuleBlocks;
use super::scratch::Blocks;
use crate::execute::gpu::error::GpuError;
use crate::execute::gpu::frame::Command;
use crate::execute::gpu::memory::{Block, Part};
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
