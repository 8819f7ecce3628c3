//! How the engines of a device work.

use std::path::PathBuf;
use std::sync::Arc;

use pairmask_shaders::Stage;

use super::{Checks, Gpu, GpuError, Pipelines, SharedImports, Tuning, Upload};

/// The default is what the daemon uses; most of the rest is for tests.
#[derive(Clone, Default)]
pub struct EngineOptions {
    pub checks: Checks,
    /// Way of the boxes; `None` chooses by where they are, how many, and whether another frame is
    /// under way. [`Upload::DmaCopy`] brings all of them ahead, of the grid alone.
    pub upload: Option<Upload>,
    /// Tile shape of all pairs; `None` chooses by count.
    pub tuning: Option<Tuning>,
    pub profiled: bool,
    /// Most bytes of a band's matrix of all pairs; small values force many bands.
    pub matrix_bytes: Option<u64>,
    /// Folder of the pipeline cache; `None` keeps none.
    pub cache_folder: Option<PathBuf>,
    /// Fill new video memory with a pattern: what no stage wrote must not show.
    pub poison: Option<u32>,
    /// What is imported; to be shared by the engines of a device.
    pub imports: SharedImports,
    /// Share the searches of scenes that several GPUs keep however small they are.
    pub shares_always: bool,
}

impl EngineOptions {
    pub(super) fn pipelines(
        &self,
        gpu: &Arc<Gpu>,
        mut stages: impl Iterator<Item = Stage>,
    ) -> Result<Pipelines, GpuError> {
        let mut pipelines = Pipelines::new(gpu, self.checks, self.cache_folder.as_deref())?;
        stages.try_for_each(|stage| pipelines.get(stage).map(drop))?;
        pipelines.save();
        Ok(pipelines)
    }
}
