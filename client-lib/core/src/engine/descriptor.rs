//! What is known of an engine beside its code: everything that chooses among engines, names them or
//! measures them asks here.

use super::{CostTerm, CullError, Engine, EngineName, GpuCost};
use crate::isa::{AvailableIsa, Isa};
use crate::mask::Encoding;
use crate::precision::BoxForm;
use crate::stats::SceneStats;

/// An engine, as the command line, the plan and dispatch see it.
#[derive(Clone, Copy, Debug)]
pub struct EngineDescriptor {
    /// The name on the command line and in reports.
    pub name: &'static str,
    /// The number in requests and replies, not 0, and never that of an engine that was.
    pub wire_number: u32,
    /// Forms of boxes that it reads where they lie. Others have to be made f32 first.
    pub forms: &'static [BoxForm],
    /// Encodings that it writes.
    pub encodings: &'static [Encoding],
    /// Whether its words are of an order of its own, and not of the boxes'.
    pub has_order: bool,
    /// Where it runs, and what that takes.
    pub slot: EngineSide,
}

/// Where an engine runs.
#[derive(Clone, Copy, Debug)]
pub enum EngineSide {
    /// On the CPU, in any process.
    Cpu(CpuEngine),
    /// On a GPU, in a daemon, which makes it.
    Gpu(GpuEngine),
}

/// A CPU engine: how it is made, and its share of the plan's cost model.
#[derive(Clone, Copy, Debug)]
pub struct CpuEngine {
    /// Makes one with empty scratch memory.
    pub make: fn(AvailableIsa) -> Box<dyn Engine>,
    /// The work that it does, less its mask.
    pub terms: &'static [CostTerm],
}

/// A GPU engine's share of the plan's cost model.
#[derive(Clone, Copy, Debug)]
pub struct GpuEngine {
    /// What its own stages take for a frame, ns; `None` where this GPU has no such engine.
    pub execute_ns: fn(&GpuCost, &SceneStats) -> Option<f64>,
}

impl EngineDescriptor {
    /// An engine of the CPU, which reads boxes in f32 and writes masks of every encoding.
    pub(super) const fn of_cpu(
        name: &'static str,
        wire_number: u32,
        has_order: bool,
        cpu: CpuEngine,
    ) -> Self {
        let (forms, encodings, slot) = (&[BoxForm::F32], &Encoding::ALL, EngineSide::Cpu(cpu));
        Self { name, wire_number, forms, encodings, has_order, slot }
    }

    /// The engine as one of the CPU.
    pub const fn cpu(&self) -> Option<&CpuEngine> {
        match &self.slot {
            EngineSide::Cpu(cpu) => Some(cpu),
            EngineSide::Gpu(_) => None,
        }
    }
}

/// A CPU engine with one instruction set and empty scratch memory.
///
/// # Errors
/// [`CullError::Unavailable`] for an engine of the GPU, and where this machine does not have the
/// instruction set.
pub fn cpu_engine(name: EngineName, isa: Isa) -> Result<Box<dyn Engine>, CullError> {
    let gpu = CullError::Unavailable { engine: name, why: "it needs a daemon with a GPU" };
    let cpu = name.descriptor().cpu().ok_or(gpu)?;
    super::available(isa, name).map(cpu.make)
}
