//! An engine of the GPU with the shared memory of its frames.

use std::sync::Arc;

use pairmask_core::engine::{CullError, CullInput, CullReport, Engine};
use pairmask_core::{Aabb, Encoding};
use pairmaskd::execute::gpu::{AllPairs, Gpu, Grid, SharedImports, StepTime};

use super::BenchError;
use super::shared::Segment;

/// An engine with its shared memory.
pub(super) struct Rig<E> {
    pub(super) engine: E,
    encoding: Encoding,
    n: usize,
    pub(super) boxes: Segment,
    pub(super) reply: Segment,
    /// Whether boxes and reply were imported.
    pub(super) imported: bool,
}

impl<E: Engine> Rig<E> {
    /// An engine, with memory for boxes and a reply, which are imported where `imports` is there and the driver
    /// imports memory.
    pub(super) fn new(
        engine: E,
        gpu: &Arc<Gpu>,
        imports: Option<&SharedImports>,
        boxes: &[Aabb],
        reply_words: u64,
        encoding: Encoding,
    ) -> Result<Self, BenchError> {
        let mut rig = Self {
            engine,
            encoding,
            n: boxes.len(),
            boxes: Segment::new(size_of_val(boxes))?,
            reply: Segment::new(4 * reply_words as usize)?,
            imported: imports.is_some(),
        };
        for segment in [&mut rig.boxes, &mut rig.reply] {
            let Some(imports) = imports else { break };
            if let Err(error) = segment.import(gpu, imports) {
                log::warn!("staged: {error}");
                rig.imported = false;
            }
        }
        rig.boxes.write(boxes);
        Ok(rig)
    }

    /// A frame of the boxes in shared memory.
    pub(super) fn frame(&mut self) -> Result<CullReport, CullError> {
        let boxes = self.boxes.boxes(self.n);
        let input = CullInput::boxes(boxes).encoding(self.encoding);
        self.engine.cull(&input, &mut self.reply)
    }
}

/// An engine that tells the times of its last frame's steps.
pub trait Stepped: Engine {
    /// The times.
    fn step_times(&self) -> &[StepTime];
}

impl Stepped for Grid {
    fn step_times(&self) -> &[StepTime] {
        self.step_times()
    }
}

impl Stepped for AllPairs {
    fn step_times(&self) -> &[StepTime] {
        self.step_times()
    }
}

/// A value that so many of a hundred are not above; NaN of none.
pub(super) fn percentile(mut values: Vec<f64>, percent: usize) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() * percent / 100).copied().unwrap_or(f64::NAN)
}
