//! The times of the cost model on one machine.

use super::SceneStats;
use crate::engine::{EngineName, built_in_ns, encoding_cost};
use crate::isa::Isa;
use crate::mask::Encoding;

/// What this machine takes for what. Built-in figures are the default; a daemon beside a GPU scales them at its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    isa: Isa,
    /// Time of each engine of the CPU, in built-in times.
    pub engines: [f64; EngineName::ALL.len()],
    /// The same of the masks of each encoding, which are written and iterated over.
    pub masks: [f64; Encoding::ALL.len()],
}

impl Calibration {
    /// Figures for an instruction set, those that engines and encodings declare: of a Zen 4 core,
    /// tests of pairs scaled by the lanes of narrower sets.
    pub const fn built_in(isa: Isa) -> Self {
        let (engines, masks) = ([1.0; EngineName::ALL.len()], [1.0; Encoding::ALL.len()]);
        Self { isa, engines, masks }
    }

    /// Time of an engine from boxes to mask on one thread, ns; `None` for a GPU's.
    pub fn cull_ns(
        &self,
        engine: EngineName,
        encoding: Encoding,
        stats: &SceneStats,
    ) -> Option<f64> {
        let descriptor = engine.descriptor();
        let own = descriptor.cpu()?.terms;
        let engine_ns = built_in_ns(own, stats, descriptor.has_order, self.isa);
        let write = encoding_cost(encoding).write;
        let mask_ns = built_in_ns(write, stats, descriptor.has_order, self.isa);
        Some(self.engines[engine.ordinal()] * engine_ns + self.masks[encoding.ordinal()] * mask_ns)
    }

    /// Time of a client that iterates over every pair of an engine's mask on one thread, ns.
    pub fn iterate_ns(&self, engine: EngineName, encoding: Encoding, stats: &SceneStats) -> f64 {
        let (iterate, has_order) = (encoding_cost(encoding).iterate, engine.descriptor().has_order);
        self.masks[encoding.ordinal()] * built_in_ns(iterate, stats, has_order, self.isa)
    }
}
