//! Every WGSL file resolves, validates and agrees with the Rust side.

use std::collections::BTreeSet;
use std::path::Path;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use pairmask_core::BoxForm;

use crate::compose::SHARED;
use crate::constants::{BATCH_BOXES, CAST_LANES, MAX_STRIP_BLOCKS, PAIRS_WORKGROUP};
use crate::layouts::{LAYOUTS, Layout};
use crate::{
    Found, GridStage, PairsVariant, RowsPerThread, Rules, SceneStage, Stage, compose, shared_part,
};

/// Every form that a stage is compiled in.
fn all_forms() -> Vec<Stage> {
    let mut forms = vec![Stage::PackDense, Stage::WriteSparse, Stage::WriteList, Stage::Awake];
    forms.extend(BoxForm::ALL.map(Stage::Keys));
    for rules in [Rules::Without, Rules::With] {
        forms.extend(BoxForm::ALL.map(|form| Stage::Grid(GridStage::Cells(form, rules))));
        for found in Found::ALL {
            forms.extend(
                [GridStage::Pairs(found, rules), GridStage::Write(found, rules)].map(Stage::Grid),
            );
        }
    }
    forms.extend([GridStage::Scan, GridStage::Scatter, GridStage::Slot].map(Stage::Grid));
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
    let text = stage.composed().wgsl;
    naga::front::wgsl::parse_str(&text)
        .unwrap_or_else(|e| panic!("{}: {}", stage.label(), e.emit_to_string(&text)))
}

#[test]
fn every_form_of_every_stage_validates_and_binds_from_zero_on() {
    let forms = all_forms();
    assert_eq!(forms.len(), 4 + 4 + 2 * (4 + 2 + 2) + 3 + 15 + 4 + 2 * 3 * 2 * 5);
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
            Stage::Scene(SceneStage::CastRays | SceneStage::CastSpheres) => CAST_LANES,
            _ => BATCH_BOXES,
        };
        assert_eq!(entry.workgroup_size, [expected, 1, 1], "{}", stage.label());
        let bound = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
        let mut bound: Vec<_> = bound.map(|b| (b.group, b.binding)).collect();
        bound.sort_unstable();
        let numbers = (0..bound.len() as u32).map(|b| (0, b));
        assert!(bound.iter().copied().eq(numbers), "{}: {bound:?}", stage.label());
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
    let labels: BTreeSet<String> = all_forms().iter().map(|s| s.label().to_owned()).collect();
    assert_eq!(names(&folder), labels);
    let shared: BTreeSet<String> = SHARED.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(names(&folder.join("shared")), shared);
    let text: String = all_forms().into_iter().map(|stage| stage.composed().wgsl).collect();
    for (name, part) in SHARED {
        // Bindings of rules are numbered.
        let is_own =
            |line: &&str| !line.starts_with('#') && !line.is_empty() && !line.contains("BEHIND");
        let is_whole = !part.contains("\n#part ");
        let lines = part.lines().filter(is_own).filter(|line| is_whole || !line.starts_with("//"));
        lines.for_each(|line| assert!(text.contains(line), "{name}: {line} is in no stage"));
    }
}

#[test]
fn shared_parts_come_once_and_unknown_ones_stay() {
    let twice = compose("#import batch\n#import batch\n", &shared_part);
    assert_eq!(twice.matches("struct BatchReport").count(), 1);
    for (stage, import) in [
        (Stage::Keys(BoxForm::F16), "rows"),
        (Stage::PackDense, "box_form"),
        (Stage::WriteList, "found"),
        (Stage::Grid(GridStage::Pairs(Found::Pairs, Rules::With)), "written"),
    ] {
        assert_eq!(stage.part(import), None, "{}: {import}", stage.label());
    }
    let unknown = compose("#import nothing\n", &shared_part);
    assert!(naga::front::wgsl::parse_str(&unknown).is_err(), "{unknown}");
}

#[test]
fn both_files_of_a_stage_have_the_same_sections() {
    let names = |file: &str| -> Vec<String> {
        let text = shared_part(file).expect("a file of that name");
        text.lines().filter_map(|line| line.strip_prefix("#part ").map(str::to_owned)).collect()
    };
    for stage in ["pairs", "grid"] {
        assert_eq!(names(&format!("{stage}_of_boxes")), names(&format!("{stage}_of_spheres")));
    }
}

/// Compares a struct with the one of that name in WGSL, where a module has such.
fn same_layout(module: &naga::Module, (name, size, members): &Layout) -> bool {
    // The same, of atomics.
    let other = if *name == "BatchTotals" { "SummedTotals" } else { name };
    let types = module.types.iter().map(|(_, ty)| (ty.name.as_deref(), &ty.inner));
    for (found, inner) in types {
        if let naga::TypeInner::Struct { members: reflected, span } = inner
            && (found == Some(name) || found == Some(other))
        {
            assert_eq!(*span as usize, *size, "size of {name}");
            let reflected = reflected.iter().map(|m| (m.name.as_deref(), m.offset as usize));
            let expected = members.iter().map(|(name, offset)| (Some(*name), *offset));
            assert!(reflected.eq(expected), "members of {name}");
            return true;
        }
    }
    false
}

#[test]
fn structs_lie_in_memory_as_in_rust() {
    let modules: Vec<naga::Module> = all_forms().into_iter().map(module).collect();
    for layout in LAYOUTS {
        let found = modules.iter().filter(|module| same_layout(module, layout)).count();
        assert!(found > 0, "{} is in no stage", layout.0);
    }
}

#[test]
#[should_panic(expected = "members of KeysParams")]
fn the_layout_check_notices_a_moved_member() {
    let moved = ("KeysParams", 8, &[("n", 4), ("plane_words", 0)][..]);
    same_layout(&module(Stage::Keys(BoxForm::F32)), &moved);
}
