//! The engines by name.

use std::fmt;

/// The engines by name. The names are part of the command line's contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum EngineName {
    /// All pairs on the CPU, SIMD.
    CpuBrute = 1,
    /// Sweep and prune on the CPU.
    CpuSap = 2,
    /// Uniform grid with levels on the CPU.
    CpuGrid = 3,
    /// All pairs on the GPU.
    GpuBrute = 4,
    /// Uniform grid with levels on the GPU.
    GpuGrid = 5,
}

impl EngineName {
    /// Every engine, in the order of their numbers.
    pub const ALL: [Self; 5] =
        [Self::CpuBrute, Self::CpuSap, Self::CpuGrid, Self::GpuBrute, Self::GpuGrid];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::CpuBrute => "cpu-brute",
            Self::CpuSap => "cpu-sap",
            Self::CpuGrid => "cpu-grid",
            Self::GpuBrute => "gpu-brute",
            Self::GpuGrid => "gpu-grid",
        }
    }

    /// The engine of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|e| *e as u32 == value)
    }

    /// The engine of a name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|engine| engine.as_str() == name)
    }

    /// All names for a text, the last one after `last`: ", " or " or ".
    pub fn listed(last: &str) -> String {
        let names = Self::ALL.map(Self::as_str);
        let (end, most) = names.split_last().unwrap_or((&"", &[]));
        [&most.join(", "), *end].join(last)
    }

    /// Whether the engine needs a GPU.
    pub const fn is_gpu(self) -> bool {
        matches!(self, Self::GpuBrute | Self::GpuGrid)
    }
}

impl fmt::Display for EngineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
