//! A scene of a GPU beside one of the cores, where scenes are too large or too hard for the model.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::scene::{Edit, Report, Scene, SceneError, SceneOptions, Step};
use pairmaskd::execute::gpu::{GpuScene, SceneTools};

use super::model::Received;
use crate::frames::sets;

pub struct BesideCore {
    pub core: Scene,
    pub gpu: GpuScene,
}

impl BesideCore {
    pub fn new(tools: &[Arc<SceneTools>]) -> Self {
        Self::with_options(tools, SceneOptions::default())
    }

    pub fn with_options(tools: &[Arc<SceneTools>], options: SceneOptions) -> Self {
        Self { core: Scene::new(options), gpu: GpuScene::shared(tools, options) }
    }

    /// Makes an edit of both, and compares what they report. Says whether the GPU refused what the cores did not.
    pub fn try_edit(&mut self, steps: &[Step<'_>], report: Report) -> Result<(), SceneError> {
        self.core.edit(Edit { steps }, report).expect("an answer");
        let received = self.gpu.edit(Edit { steps }, report).map(Received::from)?;
        // Not `assert_eq`, which would print thousands of pairs.
        assert!(received == Received::from(self.core.reported()), "{report:?}");
        Ok(())
    }

    pub fn edit(&mut self, steps: &[Step<'_>], report: Report, what: &str) {
        self.try_edit(steps, report).unwrap_or_else(|error| panic!("{what}, {report:?}: {error}"));
    }

    /// Sets boxes from an index on, and removes all else.
    pub fn become_boxes(&mut self, boxes: &[Aabb], report: Report, what: &str) {
        let (n, held) = (boxes.len() as u32, self.core.len() as u32);
        self.edit(&[Step::Remove((n.min(held)..held).into()), sets(0..n, boxes)], report, what);
    }

    pub fn acknowledge(&mut self) {
        self.core.acknowledge();
        self.gpu.acknowledge();
    }
}
