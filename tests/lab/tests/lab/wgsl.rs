//! Every WGSL file of the studies resolves, validates and agrees with the Rust side.

use std::collections::BTreeSet;
use std::mem::offset_of;
use std::path::Path;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use pairmask_lab::study::harness::stage_bench::StudyStage;
use pairmask_lab::study::mapping::layouts::{
    MappingErrorsParams, MappingPairsParams, MappingTally, MappingTimeParams, MaskParams,
    RootParams, RootTally,
};
use pairmask_lab::study::mapping::stage::MappingStage;
use pairmask_lab::study::sweep::layouts::SweepParams;
use pairmask_lab::study::sweep::stage::SweepStage;
use pairmask_shaders::constants::BATCH_BOXES;

fn module(stage: impl StudyStage) -> naga::Module {
    let text = stage.composed().expect("composes").wgsl;
    naga::front::wgsl::parse_str(&text)
        .unwrap_or_else(|e| panic!("{}: {}", stage.label(), e.emit_to_string(&text)))
}

fn validates(stage: impl StudyStage) {
    let module = module(stage);
    let capabilities = Capabilities::IMMEDIATES | Capabilities::SHADER_INT64;
    Validator::new(ValidationFlags::all(), capabilities)
        .validate(&module)
        .unwrap_or_else(|e| panic!("{}: {e:?}", stage.label()));
    let entry = &module.entry_points[0];
    assert_eq!((module.entry_points.len(), entry.name.as_str()), (1, "main"));
    assert_eq!(entry.workgroup_size, [BATCH_BOXES, 1, 1], "{}", stage.label());
}

#[test]
fn every_form_of_every_stage_validates() {
    let forms = MappingStage::all_forms();
    assert_eq!(forms.len(), 25 * 2 * 3 + 9 * 2 + 4);
    forms.into_iter().for_each(validates);
    SweepStage::ALL.into_iter().for_each(validates);
}

#[test]
fn every_file_belongs_to_a_stage() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let names = |folder: &Path| -> BTreeSet<String> {
        std::fs::read_dir(folder)
            .expect("the folder is in the repository")
            .filter_map(|entry| entry.expect("readable").file_name().into_string().ok())
            .filter_map(|name| name.strip_suffix(".wgsl").map(str::to_owned))
            .collect()
    };
    let of_sweep = SweepStage::ALL.iter().map(|stage| stage.label().to_owned());
    let of_mapping = MappingStage::ALL.iter().map(|stage| stage.label().to_owned());
    let stages: BTreeSet<String> = of_mapping.chain(of_sweep).collect();
    assert_eq!(names(&folder), stages);
    let used = [
        "pair_ids",
        "each_id",
        "row_order",
        "mask_test",
        "root_built_in",
        "root_newton",
        "map_closed",
        "map_far_end",
        "map_row_search",
        "map_fold",
        "map_word_step",
        "map_lazy",
        "sweep_params",
        "sweep_digits",
    ];
    assert_eq!(names(&folder.join("shared")), BTreeSet::from(used.map(str::to_owned)));
}

fn binds(stage: impl StudyStage) {
    let bound: BTreeSet<(u32, u32)> = module(stage)
        .global_variables
        .iter()
        .filter_map(|(_, variable)| variable.binding)
        .map(|b| (b.group, b.binding))
        .collect();
    let count = stage.composed().expect("composes").binding_count;
    let expected: BTreeSet<_> = (0..count).map(|b| (0, b)).collect();
    assert_eq!(bound, expected, "{}", stage.label());
}

#[test]
fn bindings_are_numbered_from_zero_and_counted() {
    MappingStage::all_forms().into_iter().for_each(binds);
    SweepStage::ALL.into_iter().for_each(binds);
}

/// Compares a Rust struct with the WGSL struct of the same name: size, members, offsets.
fn same_layout(stage: impl StudyStage, name: &str, size: usize, members: &[(&str, usize)]) {
    let module = module(stage);
    let (reflected, span) = module
        .types
        .iter()
        .find_map(|(_, ty)| match &ty.inner {
            naga::TypeInner::Struct { members, span } if ty.name.as_deref() == Some(name) => {
                Some((members.clone(), *span))
            }
            _ => None,
        })
        .unwrap_or_else(|| panic!("{name} is not in {}", stage.label()));
    assert_eq!(span as usize, size, "size of {name}");
    let reflected: Vec<(String, usize)> =
        reflected.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize)).collect();
    let expected: Vec<(String, usize)> =
        members.iter().map(|(name, offset)| ((*name).to_owned(), *offset)).collect();
    assert_eq!(reflected, expected, "members of {name}");
}

macro_rules! same_layout {
    ($stage:expr, $name:ident { $($member:ident),* }) => {
        same_layout($stage, stringify!($name), size_of::<$name>(), &[
            $((stringify!($member), offset_of!($name, $member))),*
        ]);
    };
}

#[test]
fn structs_lie_in_memory_as_in_rust() {
    let [pairs, errors, time, root_errors, root_time, mask, mask_or] = MappingStage::ALL;
    same_layout!(pairs, MappingPairsParams { n, id_count });
    same_layout!(
        errors,
        MappingErrorsParams {
            n,
            word_count,
            groups_x,
            around_rows,
            first_low,
            first_high,
            stride_low,
            stride_high,
            mark
        }
    );
    same_layout!(errors, MappingTally { ids, skipped, wrong, wrong_named, row_error, distinct });
    same_layout!(time, MappingTimeParams { n, word_count, groups_x, never });
    for stage in [root_errors, root_time] {
        same_layout!(stage, RootParams { count, word_count, groups_x, never });
    }
    same_layout!(root_errors, RootTally { other, inexact });
    for stage in [mask, mask_or] {
        same_layout!(stage, MaskParams { n, pair_count, thread_count, groups_x });
    }
    for stage in SweepStage::ALL {
        same_layout!(
            stage,
            SweepParams {
                n,
                entry_capacity,
                pair_capacity,
                axes,
                place_bits,
                tube_bits_0,
                tube_bits_1,
                pass_number,
                shift,
                tiles,
                thread_rounds,
                origin_0,
                origin_1,
                origin_2,
                scale_0,
                scale_1,
                scale_2
            }
        );
    }
}

#[test]
#[should_panic(expected = "members of RootTally")]
fn the_layout_check_notices_a_moved_member() {
    let [_, _, _, root_errors, ..] = MappingStage::ALL;
    same_layout(root_errors, "RootTally", 8, &[("other", 4), ("inexact", 0)]);
}
