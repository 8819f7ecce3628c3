//! The parts of stages that differ by what the objects are: boxes or spheres.
//!
//! A file of them has one section for each part, which starts with a line `#part NAME`. A part stands
//! where its stage says `#import NAME`, within a function too.

use pairmask_core::BoxForm;

use crate::compose::{GridStage, RowsPerThread, Stage};

const PAIRS_OF_BOXES: &str = include_str!("../wgsl/shared/pairs_of_boxes.wgsl");
const PAIRS_OF_SPHERES: &str = include_str!("../wgsl/shared/pairs_of_spheres.wgsl");
const GRID_OF_BOXES: &str = include_str!("../wgsl/shared/grid_of_boxes.wgsl");
const GRID_OF_SPHERES: &str = include_str!("../wgsl/shared/grid_of_spheres.wgsl");

/// The section of that name, without the blank lines around it.
fn section(text: &str, name: &str) -> Option<String> {
    let mut sections = text.split("#part ").skip(1).filter_map(|part| part.split_once('\n'));
    let (_, body) = sections.find(|(head, _)| *head == name)?;
    let body = body.trim_matches('\n');
    Some(if body.is_empty() { String::new() } else { format!("{body}\n") })
}

/// The part of that name of a stage, if what it says depends on the objects.
pub(crate) fn object_part(stage: Stage, name: &str) -> Option<String> {
    section(sections_of(stage)?, name)
}

const fn sections_of(stage: Stage) -> Option<&'static str> {
    match stage {
        Stage::Pairs(_) => Some(PAIRS_OF_BOXES),
        Stage::SpherePairs(_) => Some(PAIRS_OF_SPHERES),
        Stage::Keys(_) | Stage::Grid(GridStage::Cells(..) | GridStage::Pairs(..)) => {
            Some(GRID_OF_BOXES)
        }
        Stage::SphereKeys | Stage::Grid(GridStage::SphereCells | GridStage::SpherePairs(_)) => {
            Some(GRID_OF_SPHERES)
        }
        _ => None,
    }
}

/// How the objects that a stage reads lie in memory: bytes of one, and the text that makes bits of a box
/// of it. `None` for a stage that reads none.
pub(crate) const fn object_form(stage: Stage) -> Option<(usize, &'static str)> {
    let form = match stage {
        Stage::SphereKeys | Stage::Grid(GridStage::SphereCells) => {
            let text = include_str!("../wgsl/shared/boxes_spheres.wgsl");
            return Some((pairmask_core::sphere::SPHERE_BYTES, text));
        }
        Stage::Keys(form) | Stage::Grid(GridStage::Cells(form, _)) => form,
        Stage::Scene(crate::compose::SceneStage::Apply) => BoxForm::F32,
        _ => return None,
    };
    let text = match form {
        BoxForm::F32 => include_str!("../wgsl/shared/boxes_f32.wgsl"),
        BoxForm::Q16 => include_str!("../wgsl/shared/boxes_q16.wgsl"),
        BoxForm::Q8 => include_str!("../wgsl/shared/boxes_q8.wgsl"),
        BoxForm::F16 => include_str!("../wgsl/shared/boxes_f16.wgsl"),
    };
    Some((form.box_bytes(), text))
}

/// What the pairs stage has for the rows of a thread.
pub(crate) fn rows(stage: Stage) -> Option<String> {
    let (variant, of_spheres) = match stage {
        Stage::Pairs(variant) => (variant, false),
        Stage::SpherePairs(variant) => (variant, true),
        _ => return None,
    };
    let (rows, sphere_rows) = match variant.rows {
        RowsPerThread::One => (
            include_str!("../wgsl/shared/rows_1.wgsl"),
            include_str!("../wgsl/shared/sphere_rows_1.wgsl"),
        ),
        RowsPerThread::Two => (
            include_str!("../wgsl/shared/rows_2.wgsl"),
            include_str!("../wgsl/shared/sphere_rows_2.wgsl"),
        ),
        RowsPerThread::Four => (
            include_str!("../wgsl/shared/rows_4.wgsl"),
            include_str!("../wgsl/shared/sphere_rows_4.wgsl"),
        ),
    };
    Some(if of_spheres { format!("{rows}\n{sphere_rows}") } else { rows.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_are_found_by_their_names() {
        let text = "head\n#part one\na\nb\n\n#part none\n#part two\n\nc";
        let of = |name| section(text, name);
        assert_eq!(of("one").as_deref(), Some("a\nb\n"));
        assert_eq!(of("none").as_deref(), Some(""));
        assert_eq!(of("two").as_deref(), Some("c\n"));
        assert_eq!(of("on"), None);
    }

    #[test]
    fn both_files_of_a_stage_have_the_same_sections() {
        let names = |text: &'static str| -> Vec<&str> {
            text.lines().filter_map(|line| line.strip_prefix("#part ")).collect()
        };
        assert_eq!(names(PAIRS_OF_BOXES), names(PAIRS_OF_SPHERES));
        assert_eq!(names(GRID_OF_BOXES), names(GRID_OF_SPHERES));
    }
}
