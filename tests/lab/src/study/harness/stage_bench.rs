//! Stages of a study on a device: compiled when first asked for, run step by step, timed by the GPU's clock.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::Arc;
use std::time::Duration;

use bytemuck::Pod;
use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::{ComposeError, ComposedStage};
use pairmaskd::execute::gpu::{
    Block, Checks, Command, Frame, Gpu, GpuError, Home, Part, Pipeline, Pipelines, StageFault,
    StepTime, Wait,
};

/// Time after which a study frame is given up: a thousand times a GPU's need, and enough for a
/// software adapter.
const PATIENCE: Duration = Duration::from_secs(120);

/// A stage of a study.
pub trait StudyStage: Copy + Eq + Hash {
    /// The name of the file, of the pipeline and of the timing row.
    fn label(self) -> &'static str;

    /// The stage as one WGSL module, with its name and bindings.
    ///
    /// # Errors
    /// [`ComposeError`].
    fn composed(self) -> Result<ComposedStage, ComposeError>;
}

/// A device and the stages of a study compiled on it.
pub struct StageBench<S> {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
    made: HashMap<S, Arc<Pipeline>>,
}

impl<S: StudyStage> StageBench<S> {
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

    /// A step that runs a stage on whole blocks.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn command(
        &mut self,
        stage: S,
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
    fn pipeline(&mut self, stage: S) -> Result<Arc<Pipeline>, GpuError> {
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

    /// Runs steps once and gives the time of each by the GPU's clock.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn run(&self, frame: &mut Frame) -> Result<Vec<StepTime>, GpuError> {
        let wait = if self.gpu.info().is_software() { Wait::Block } else { Wait::Spin };
        frame.run(wait, PATIENCE)?;
        frame.step_times()
    }

    /// Steps that are recorded, to be run any number of times.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn frame(&self, steps: Vec<Command>) -> Result<Frame, GpuError> {
        let mut frame = Frame::new(&self.gpu, true)?;
        frame.record(steps)?;
        Ok(frame)
    }

    /// Memory of the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn host(&self, bytes: u64) -> Result<Arc<Block>, GpuError> {
        Block::new(&self.gpu, Home::Host, bytes)
    }

    /// Video memory.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn video(&self, bytes: u64) -> Result<Arc<Block>, GpuError> {
        Block::new(&self.gpu, Home::Video, bytes)
    }

    /// Workgroups that cover `threads`: as a square, so that neither side passes the limit.
    pub fn groups(&self, threads: u64) -> Option<[u32; 2]> {
        let groups = threads.div_ceil(u64::from(BATCH_BOXES)).max(1);
        let limit = u64::from(self.gpu.limits().dispatch_groups);
        let x = groups.min(limit);
        let y = groups.div_ceil(x);
        (y <= limit).then_some([x as u32, y as u32])
    }
}
