//! Every WGSL file resolves, validates and agrees with the Rust side.

use std::collections::BTreeSet;
use std::mem::offset_of;
use std::path::Path;

use crate::constants::{BATCH_BOXES, MAX_STRIP_BLOCKS, PAIRS_WORKGROUP};
use crate::layouts::{
    AwakeParams, BatchReport, BatchTotals, GridLayout, GridLevel, GridParams, GridSummary,
    GridTotals, GridWorlds, KeysParams, PackParams, PairsParams, SceneParams, SceneSummary,
    WriteParams,
};
use crate::{Found, GridStage, PairsVariant, RowsPerThread, Rules, SceneStage, Stage};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use pairmask_core::BoxForm;

const KEYS: Stage = Stage::Keys(BoxForm::F32);

fn grid_stages(found: Found, rules: Rules) -> [Stage; 6] {
    GridStage::of_frame(BoxForm::F32.into(), found, rules).map(Stage::Grid)
}

/// Every form that a stage is compiled in.
fn all_forms() -> Vec<Stage> {
    let mut forms = vec![Stage::PackDense, Stage::WriteSparse, Stage::WriteList, Stage::Awake];
    forms.extend(BoxForm::ALL.map(Stage::Keys));
    for rules in Rules::ALL {
        forms.extend(BoxForm::ALL.map(|form| Stage::Grid(GridStage::Cells(form, rules))));
        forms.extend(grid_stages(Found::Words, rules).into_iter().skip(4));
        forms.extend(grid_stages(Found::Pairs, rules).into_iter().skip(4));
    }
    forms.extend([GridStage::Scan, GridStage::Scatter, GridStage::Place].map(Stage::Grid));
    forms.extend(SceneStage::ALL.map(Stage::Scene));
    forms.extend([Stage::SphereKeys, Stage::Grid(GridStage::SphereCells)]);
    forms.extend(Found::ALL.map(|found| Stage::Grid(GridStage::SpherePairs(found))));
    for rows in RowsPerThread::ALL {
        for store_zeros in [false, true] {
            let strips = (0..).map(|log| 1 << log).take_while(|strip| *strip <= MAX_STRIP_BLOCKS);
            forms.extend(strips.flat_map(|strip_blocks| {
                let variant = PairsVariant { rows, strip_blocks, store_zeros };
                [Stage::Pairs(variant), Stage::SpherePairs(variant)]
            }));
        }
    }
    forms
}

fn module(stage: Stage) -> naga::Module {
    let text = stage.wgsl().expect("composes");
    naga::front::wgsl::parse_str(&text)
        .unwrap_or_else(|e| panic!("{}: {}", stage.label(), e.emit_to_string(&text)))
}

#[test]
fn every_form_of_every_stage_validates() {
    let forms = all_forms();
    assert_eq!(forms.len(), 4 + 4 + 2 * (4 + 2 + 2) + 3 + 11 + 4 + 2 * 3 * 2 * 5);
    for stage in forms {
        let module = module(stage);
        let capabilities = Capabilities::IMMEDIATES;
        Validator::new(ValidationFlags::all(), capabilities)
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}: {e:?}", stage.label()));
        let entry = &module.entry_points[0];
        assert_eq!((module.entry_points.len(), entry.name.as_str()), (1, "main"));
        let expected = match stage {
            Stage::Pairs(_) | Stage::SpherePairs(_) => PAIRS_WORKGROUP,
            _ => BATCH_BOXES,
        };
        assert_eq!(entry.workgroup_size, [expected, 1, 1], "{}", stage.label());
    }
}

#[test]
fn every_file_belongs_to_a_stage() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("wgsl");
    let names = |folder: &Path| -> BTreeSet<String> {
        std::fs::read_dir(folder)
            .expect("the folder is in the repository")
            .filter_map(|entry| entry.expect("readable").file_name().into_string().ok())
            .filter_map(|name| name.strip_suffix(".wgsl").map(str::to_owned))
            .collect()
    };
    let stages: BTreeSet<String> = Stage::ALL.iter().map(|s| s.label().to_owned()).collect();
    assert_eq!(names(&folder), stages);
    let shared = names(&folder.join("shared"));
    let engines = [
        "order_keys",
        "box_batch",
        "boxes_f32",
        "cells",
        "boxes_q16",
        "boxes_q8",
        "boxes_f16",
        "batch",
        "band_words",
        "found_words",
        "found_pairs",
        "written_words",
        "written_pairs",
        "grid_params",
        "grid_layout",
        "scan",
        "scene_params",
        "box_rules",
        "box_worlds_none",
        "box_worlds_ruled",
        "pair_rules_none",
        "pair_rules_ruled",
        "written_worlds_none",
        "written_worlds_ruled",
        "scene_share_part",
        "scene_share_whole",
        "scene_records",
        "scene_filter",
        "scene_found",
        "cells_around",
        "scene_search",
        "rows_1",
        "rows_2",
        "rows_4",
        "boxes_spheres",
        "grid_of_boxes",
        "grid_of_spheres",
        "pairs_of_boxes",
        "pairs_of_spheres",
        "sphere_bounds",
        "sphere_exact",
        "sphere_filter",
        "sphere_rows_1",
        "sphere_rows_2",
        "sphere_rows_4",
        "sphere_settled",
    ];
    let used: BTreeSet<String> = engines.iter().map(|s| (*s).to_owned()).collect();
    assert_eq!(shared, used);
}

#[test]
fn bindings_are_numbered_from_zero() {
    for stage in all_forms() {
        let module = module(stage);
        let bound = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
        let mut bound: Vec<_> = bound.map(|b| (b.group, b.binding)).collect();
        bound.sort_unstable();
        let expected: Vec<_> = (0..bound.len() as u32).map(|b| (0, b)).collect();
        assert_eq!(bound, expected, "{}", stage.label());
    }
}

/// Compares a Rust struct with the WGSL struct of the same name: size, members, offsets.
fn same_layout(stage: Stage, name: &str, size: usize, members: &[(&str, usize)]) {
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
    ($stage:expr, $name:ident, $wgsl:literal { $($member:ident),* }) => {
        same_layout($stage, $wgsl, size_of::<$name>(), &[
            $((stringify!($member), offset_of!($name, $member))),*
        ]);
    };
}

#[test]
fn structs_lie_in_memory_as_in_rust() {
    let pairs = Stage::ALL[1];
    same_layout!(KEYS, KeysParams, "KeysParams" { n, plane_words });
    same_layout!(KEYS, BatchTotals, "BatchTotals" { words, pairs });
    same_layout!(Stage::Awake, AwakeParams, "AwakeParams" { rounds, written });
    same_layout!(pairs, BatchTotals, "SummedTotals" { words, pairs });
    same_layout!(KEYS, BatchReport, "BatchReport" { invalid, empty, words, pairs, padding });
    same_layout!(pairs, PairsParams, "PairsParams" {
        plane_words, row0, band_rows, strip0, counted_end
    });
    for stage in [Stage::WriteSparse, Stage::WriteList] {
        same_layout!(stage, WriteParams, "WriteParams" {
            row0, band_rows, strip0, strip_end, strip_blocks, capacity
        });
    }
    same_layout!(Stage::PackDense, PackParams, "PackParams" {
        n, row0, owned_rows, band_rows, block0, word_count, first_bit, out_offset, groups_x
    });
}

#[test]
fn structs_of_the_grid_lie_in_memory_as_in_rust() {
    let stages =
        Found::ALL.into_iter().flat_map(|found| Rules::ALL.map(|rules| grid_stages(found, rules)));
    for stage in stages.flatten() {
        same_layout!(stage, GridParams, "GridParams" {
            n, plane, batch_count, super_count, sum_count, capacity, order_words, budget,
            row_tests
        });
    }
    let [cells, _, _, _, pairs, write] = grid_stages(Found::Words, Rules::Without);
    let [_, _, _, _, listed_pairs, listed_write] = grid_stages(Found::Pairs, Rules::With);
    for stage in [cells, pairs, write, listed_pairs, listed_write] {
        same_layout!(stage, GridTotals, "GridTotals" {
            items, pairs, compared, base, empty, invalid, padding
        });
        same_layout!(stage, GridLayout, "GridLayout" {
            level_count, first_giant, first_nothing, cell_end, levels, worlds
        });
        same_layout!(stage, GridWorlds, "GridWorlds" { cells, parking, count, padding });
        same_layout!(stage, GridLevel, "GridLevel" {
            origin, first_cell, scale, cell_count, low, padding_low, high, padding_high, fold,
            padding_fold, count, wraps
        });
    }
    for stage in [write, listed_write] {
        same_layout!(stage, GridSummary, "GridSummary" {
            items, pairs, compared, empty, invalid, work, giant_work, padding
        });
    }
}

#[test]
fn structs_of_scenes_lie_in_memory_as_in_rust() {
    for stage in SceneStage::ALL {
        same_layout!(Stage::Scene(stage), SceneParams, "SceneParams" {
            slots, mode, dense, epoch_low, epoch_high, set_count, set_first, set_is_range, mark_count,
            naming, entry_capacity, pair_capacity, table_words, filter_words, control_words, budget,
            query_count, thread_rounds, rows_together, share_count, share
        });
    }
    same_layout!(Stage::Scene(SceneStage::Pairs), SceneSummary, "SceneSummary" {
        found, ended, tested, entries, rows, moved, moved_static, sampled, padding, samples
    });
}

#[test]
#[should_panic(expected = "members of KeysParams")]
fn the_layout_check_notices_a_moved_member() {
    same_layout(KEYS, "KeysParams", 8, &[("n", 4), ("plane_words", 0)]);
}
