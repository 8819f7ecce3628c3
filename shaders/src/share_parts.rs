//! The parts of stages that differ by how much of a frame a GPU does, and by whether it has rules.

use crate::compose::{Found, GridStage, Share, Stage};

/// Bindings of the pairs stage up to the last of what it finds: words have an order, which goes down.
const fn found_bindings(found: Found) -> u32 {
    match found {
        Found::Words => 7,
        Found::Pairs => 6,
    }
}

/// The part of that name of a stage, if what it says depends on the share. Frames of spheres are not
/// shared.
pub(crate) fn share_part(stage: Stage, name: &str) -> Option<String> {
    let Stage::Grid(stage) = stage else { return None };
    let share = match stage {
        GridStage::Cells(_, share) | GridStage::Pairs(_, share) | GridStage::Write(_, share) => {
            share
        }
        _ => Share::Whole,
    };
    let texts = match (name, stage) {
        ("share_boxes", GridStage::Cells(..) | GridStage::SphereCells) => (
            include_str!("../wgsl/shared/share_boxes_whole.wgsl"),
            include_str!("../wgsl/shared/share_boxes_part.wgsl"),
            include_str!("../wgsl/shared/share_boxes_ruled.wgsl"),
        ),
        ("share_rows", GridStage::Pairs(..) | GridStage::SpherePairs(_) | GridStage::Write(..)) => {
            (
                include_str!("../wgsl/shared/share_rows_whole.wgsl"),
                include_str!("../wgsl/shared/share_rows_part.wgsl"),
                include_str!("../wgsl/shared/share_rows_whole.wgsl"),
            )
        }
        ("share_noted", GridStage::Pairs(..) | GridStage::SpherePairs(_)) => (
            include_str!("../wgsl/shared/share_noted_whole.wgsl"),
            include_str!("../wgsl/shared/share_noted_part.wgsl"),
            include_str!("../wgsl/shared/share_noted_whole.wgsl"),
        ),
        ("pair_rules", GridStage::Pairs(..) | GridStage::SpherePairs(_)) => (
            include_str!("../wgsl/shared/pair_rules_none.wgsl"),
            include_str!("../wgsl/shared/pair_rules_none.wgsl"),
            include_str!("../wgsl/shared/pair_rules_ruled.wgsl"),
        ),
        ("written_worlds", GridStage::Write(..)) => (
            include_str!("../wgsl/shared/written_worlds_none.wgsl"),
            include_str!("../wgsl/shared/written_worlds_none.wgsl"),
            include_str!("../wgsl/shared/written_worlds_ruled.wgsl"),
        ),
        _ => return None,
    };
    if let (Share::Ruled, GridStage::Pairs(found, _), "pair_rules") = (share, stage, name) {
        let first = found_bindings(found);
        let numbered = texts.2.replace("@binding(RULES)", &format!("@binding({first})"));
        let last = format!("@binding({})", first + 1);
        return Some(numbered.replace("@binding(ROW_WORLDS)", &last));
    }
    let (whole, part, ruled) = texts;
    let text = match share {
        Share::Whole => whole,
        Share::Part => part,
        Share::Ruled => ruled,
    };
    Some(text.to_owned())
}
