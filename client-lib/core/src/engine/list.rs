//! The list of all engines. Of two that take the same time, the plan takes the first.

use super::name::engines;
use super::{EngineDescriptor, brute_force, gpu, grid, sweep_and_prune, tree};

engines! {
    /// All pairs on the CPU, SIMD.
    CpuBrute => brute_force::DESCRIPTOR,
    /// Sweep and prune on the CPU.
    CpuSap => sweep_and_prune::DESCRIPTOR,
    /// Uniform grid with levels on the CPU.
    CpuGrid => grid::DESCRIPTOR,
    /// Tree of boxes on the CPU.
    CpuTree => tree::DESCRIPTOR,
    /// All pairs on the GPU.
    GpuBrute => gpu::ALL_PAIRS,
    /// Uniform grid with levels on the GPU.
    GpuGrid => gpu::GRID,
}
