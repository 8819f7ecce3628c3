//! The variants on a GPU: their answers, their errors, their times.

pub mod errors;
pub mod masks;
pub mod pairs;
pub mod times;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use pairmask_shaders::constants::BATCH_BOXES;
use pairmaskd::execute::gpu::{
    Block, Checks, Command, Frame, Gpu, GpuError, Home, Part, Pipeline, Pipelines, StageFault, Wait,
};

use crate::study::mapping::stage::{IdWidth, MappingStage, Variant};

/// Time after which a study frame is given up: a thousand times a GPU's need, and enough for a
/// software adapter.
const PATIENCE: Duration = Duration::from_secs(120);

/// Ids and numbers of a word.
pub(super) const WORD_IDS: u64 = 32;

/// A device and the stages of the study compiled on it.
pub struct Bench {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
    made: HashMap<MappingStage, Arc<Pipeline>>,
}

impl Bench {
    /// Nothing compiled yet.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Arc<Gpu>, checks: Checks) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: Arc::clone(gpu),
            pipelines: Pipelines::new(gpu, checks, None)?,
            made: HashMap::new(),
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Whether the ids of a variant for `n` boxes fit this device's integers.
    pub fn fits(&self, variant: Variant, n: u32) -> bool {
        IdWidth::of(variant, n) == IdWidth::Bits32 || self.gpu.limits().int64
    }

    fn command(
        &mut self,
        stage: MappingStage,
        blocks: &[&Arc<Block>],
        immediates: &impl Pod,
        groups: [u32; 2],
    ) -> Result<Command, GpuError> {
        Ok(Command::Stage {
            pipeline: self.pipeline(stage)?,
            parts: blocks.iter().map(|block| Part::whole(block)).collect(),
            immediates: bytemuck::bytes_of(immediates).to_vec(),
            groups,
        })
    }

    /// The pipeline of a stage, compiled when first asked for.
    fn pipeline(&mut self, stage: MappingStage) -> Result<Arc<Pipeline>, GpuError> {
        if let Some(pipeline) = self.made.get(&stage) {
            return Ok(Arc::clone(pipeline));
        }
        let composed = stage
            .composed()
            .map_err(|_| GpuError::Stage { stage: stage.label(), why: StageFault::Compose })?;
        let pipeline = self.pipelines.compile(&composed)?;
        self.made.insert(stage, Arc::clone(&pipeline));
        Ok(pipeline)
    }

    /// Runs steps once and gives the nanoseconds of each by the GPU's clock.
    fn run(&self, frame: &mut Frame) -> Result<Vec<f64>, GpuError> {
        let wait = if self.gpu.info().is_software() { Wait::Block } else { Wait::Spin };
        frame.run(wait, PATIENCE)?;
        Ok(frame.step_times()?.into_iter().map(|step| step.ns).collect())
    }

    fn frame(&self, steps: Vec<Command>) -> Result<Frame, GpuError> {
        let mut frame = Frame::new(&self.gpu, true)?;
        frame.record(steps)?;
        Ok(frame)
    }

    fn host(&self, bytes: u64) -> Result<Arc<Block>, GpuError> {
        Block::new(&self.gpu, Home::Host, bytes)
    }

    fn video(&self, bytes: u64) -> Result<Arc<Block>, GpuError> {
        Block::new(&self.gpu, Home::Video, bytes)
    }

    /// Workgroups that cover `threads`: as a square, so that neither side passes the limit.
    fn groups(&self, threads: u64) -> Option<[u32; 2]> {
        let groups = threads.div_ceil(u64::from(BATCH_BOXES)).max(1);
        let limit = u64::from(self.gpu.limits().dispatch_groups);
        let x = groups.min(limit);
        let y = groups.div_ceil(x);
        (y <= limit).then_some([x as u32, y as u32])
    }
}

fn zeroed<T: Zeroable + Clone>(count: usize) -> Vec<T> {
    vec![T::zeroed(); count]
}
