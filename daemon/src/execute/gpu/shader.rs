//! Stages as SPIR-V.

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use pairmask_shaders::{ComposedStage, Stage};

use super::error::{GpuError, StageFault};

/// Whether stages check their indices and loops as they run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Checks {
    /// No checks: 1.4 to 2.2 times faster. Every index is in range by the plan. Loops of the grid's
    /// stages and of `write_list` stay bounded.
    #[default]
    Off,
    /// Indices are held within range and loops bounded. For tests: the answer must be the same.
    On,
}

/// Stages whose loops are bounded in production too (a counter a loop; the cost does not show in the
/// grid's).
///
/// Every loop of the grid ends by itself. All the same, on an H200 (driver 580.159.04) `grid_pairs`
/// with unbounded loops lost words of some scenes, the same ones each time (9 of 57 of the stress
/// scene `huge` with 43 boxes), and never ended on others (a mixed scene of 1,000). With bounded
/// loops and no other check it has every byte of its mirror; with checked indices and unbounded
/// loops it has not. So it is the driver's compiler that takes nested loops of different lengths
/// in one subgroup wrongly, and a counter that it cannot see through keeps it from doing so. The loops
/// of `write_list` are such loops too.
pub(super) const fn has_bounded_loops(stage: Stage) -> bool {
    matches!(stage, Stage::Grid(_) | Stage::WriteList | Stage::Scene(_) | Stage::SpherePairs(_))
}

/// Compiles a stage, with bounded loops where `bounded_loops` or the checks ask for them.
pub(super) fn spirv(
    stage: &ComposedStage,
    bounded_loops: bool,
    checks: Checks,
) -> Result<Vec<u32>, GpuError> {
    let fault = |why| GpuError::Stage { stage: stage.label, why };
    let module = naga::front::wgsl::parse_str(&stage.wgsl).map_err(|_| fault(StageFault::Parse))?;
    if !has_bindings(&module, stage.binding_count) {
        return Err(fault(StageFault::Bindings));
    }
    // 64-bit integers: stages of measurements, on devices that have them.
    let capabilities = Capabilities::IMMEDIATES | Capabilities::SHADER_INT64;
    let info = Validator::new(ValidationFlags::all(), capabilities)
        .validate(&module)
        .map_err(|_| fault(StageFault::Validate))?;
    let checked = checks == Checks::On;
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
        force_loop_bounding: checked || bounded_loops,
        emit_int_div_checks: checked,
        ..Default::default()
    };
    spv::write_vec(&module, &info, &options, None).map_err(|_| fault(StageFault::Emit))
}

/// Whether a module binds group 0 from 0 to `count` and nothing else: a pipeline's layout is made
/// from the count.
fn has_bindings(module: &naga::Module, count: u32) -> bool {
    let variables = module.global_variables.iter();
    let mut bound: Vec<(u32, u32)> = variables
        .filter_map(|(_, variable)| variable.binding)
        .map(|binding| (binding.group, binding.binding))
        .collect();
    bound.sort_unstable();
    bound.into_iter().eq((0..count).map(|binding| (0, binding)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_that_binds_other_than_it_says_is_refused() {
        let composed = Stage::PackDense.composed().expect("composes");
        assert!(spirv(&composed, false, Checks::Off).is_ok());
        for binding_count in [0, composed.binding_count - 1, composed.binding_count + 1] {
            let other = ComposedStage { binding_count, ..composed.clone() };
            let refused = GpuError::Stage { stage: other.label, why: StageFault::Bindings };
            assert_eq!(spirv(&other, false, Checks::Off), Err(refused));
        }
    }
}
