//! The engines of the GPU, as plans see them. A daemon makes them; this crate has no code for GPUs.

use super::{EngineDescriptor, EngineSide, GpuEngine};
use crate::mask::Encoding;
use crate::precision::BoxForm;
use crate::stats::SceneStats;

/// What a GPU takes, measured when it was opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuCost {
    /// A frame of no boxes: submit, wait, read back, ns.
    pub fixed_ns: f64,
    /// Boxes up, ns a box of f32.
    pub ns_a_box: f64,
    /// Each pair that all-pairs compares, ns.
    pub ns_a_test: f64,
    /// What the grid's stages take regardless of the scene, more than those of all pairs, ns.
    pub grid_fixed_ns: f64,
    /// The grid's stages, ns a box; `None` where the GPU has no grid engine.
    pub grid_ns_a_box: Option<f64>,
    /// Each byte of the mask that comes down, ns.
    pub ns_a_reply_byte: f64,
    /// More for a client that iterates over a mask in memory that the device wrote, which no cache of a
    /// core holds, ns a byte.
    pub ns_a_read_byte: f64,
}

impl GpuCost {
    /// The cost of frames whose boxes have a form: what comes up takes the time of its bytes.
    #[must_use]
    pub fn of_form(self, form: BoxForm) -> Self {
        let share = form.box_bytes() as f64 / BoxForm::F32.box_bytes() as f64;
        Self { ns_a_box: share * self.ns_a_box, ..self }
    }
}

/// `gpu-brute`: all pairs.
pub(super) const ALL_PAIRS: EngineDescriptor = EngineDescriptor {
    name: "gpu-brute",
    wire_number: 4,
    forms: &BoxForm::ALL,
    encodings: &[Encoding::Dense, Encoding::Sparse, Encoding::List],
    has_order: false,
    slot: EngineSide::Gpu(GpuEngine { execute_ns: all_pairs_ns }),
};

/// `gpu-grid`: the grid of `cpu-grid`. A dense mask has a bit for all pairs, so that all pairs is what
/// makes it.
pub(super) const GRID: EngineDescriptor = EngineDescriptor {
    name: "gpu-grid",
    wire_number: 5,
    forms: &BoxForm::ALL,
    encodings: &[Encoding::Sparse, Encoding::List],
    has_order: true,
    slot: EngineSide::Gpu(GpuEngine { execute_ns: grid_ns }),
};

#[allow(clippy::unnecessary_wraps)] // Every GPU has the engine; the type is that of all engines.
fn all_pairs_ns(gpu: &GpuCost, stats: &SceneStats) -> Option<f64> {
    Some(gpu.ns_a_test * stats.n.pair_count() as f64)
}

fn grid_ns(gpu: &GpuCost, stats: &SceneStats) -> Option<f64> {
    Some(gpu.grid_fixed_ns + gpu.grid_ns_a_box? * f64::from(stats.n.get()))
}
