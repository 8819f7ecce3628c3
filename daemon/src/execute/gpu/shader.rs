//! Stages as SPIR-V.

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use pairmask_shaders::{GridStage, Stage};

use super::error::{GpuError, StageFault};

/// Whether stages check their indices and loops as they run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Checks {
    /// No checks: 1.4 to 2.2 times faster. Every index is in range by the plan.
    #[default]
    Off,
    /// Indices are held within range and loops bounded. For tests: the answer must be the same.
    On,
}

/// Stages that keep their checks in production.
///
/// Without them `grid_pairs` lost words of some scenes on an H200 (driver 580.159.04), the same ones
/// each time, and ran for ever on others; with them it has every byte of its mirror. No index that
/// it computes leaves its array and each loop ends (the mirror and the poison tests look for that),
/// so the cause is taken to be in what the driver's compiler assumes of it.
fn is_always_checked(stage: Stage) -> bool {
    stage == Stage::Grid(GridStage::Pairs)
}

/// Compiles a stage.
pub(super) fn spirv(stage: Stage, checks: Checks) -> Result<Vec<u32>, GpuError> {
    let fault = |why| GpuError::Stage { stage: stage.label(), why };
    let text = stage.wgsl().map_err(|_| fault(StageFault::Compose))?;
    let module = naga::front::wgsl::parse_str(&text).map_err(|_| fault(StageFault::Parse))?;
    // 64-bit integers: stages of the mapping study, on devices that have them.
    let capabilities = Capabilities::IMMEDIATES | Capabilities::SHADER_INT64;
    let info = Validator::new(ValidationFlags::all(), capabilities)
        .validate(&module)
        .map_err(|_| fault(StageFault::Validate))?;
    let checked = checks == Checks::On || is_always_checked(stage);
    let policy = if checked { BoundsCheckPolicy::Restrict } else { BoundsCheckPolicy::Unchecked };
    let options = spv::Options {
        // Vulkan 1.1, which every driver in use has.
        lang_version: (1, 3),
        flags: spv::WriterFlags::empty(),
        bounds_check_policies: BoundsCheckPolicies {
            index: policy,
            buffer: policy,
            image_load: policy,
            binding_array: policy,
        },
        // Stages set what they read of workgroup memory. Not even for the checks: lavapipe turns
        // the zeroing of an array into a store an element and compiles for 20 s.
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: checked,
        emit_int_div_checks: checked,
        ..Default::default()
    };
    spv::write_vec(&module, &info, &options, None).map_err(|_| fault(StageFault::Emit))
}
