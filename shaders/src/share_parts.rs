//! The parts of stages that differ by how much of a frame a GPU does, and by whether it has rules.

use crate::compose::{GridStage, SceneStage, Share, Stage};

/// The part of that name of a stage, if what it says depends on the share. Frames of spheres are not
/// shared, and have no rules.
pub(crate) fn share_part(stage: Stage, name: &str) -> Option<String> {
    let stage = match stage {
        Stage::Grid(stage) => stage,
        Stage::Scene(stage) => return scene_part(stage, name),
        _ => return None,
    };
    let share = match stage {
        GridStage::Cells(_, share) | GridStage::Pairs(_, share) | GridStage::Write(_, share) => {
            share
        }
        _ => Share::Whole,
    };
    let (whole, part) = match name {
        "share_boxes" => (
            include_str!("../wgsl/shared/share_boxes_whole.wgsl"),
            include_str!("../wgsl/shared/share_boxes_part.wgsl"),
        ),
        "share_rows" => (
            include_str!("../wgsl/shared/share_rows_whole.wgsl"),
            include_str!("../wgsl/shared/share_rows_part.wgsl"),
        ),
        "share_noted" => (
            include_str!("../wgsl/shared/share_noted_whole.wgsl"),
            include_str!("../wgsl/shared/share_noted_part.wgsl"),
        ),
        _ => return rules_part(stage, share, name),
    };
    Some(if share == Share::Part { part } else { whole }.to_owned())
}

/// The part of that name of a scene's stage, if what it says depends on the share.
fn scene_part(stage: SceneStage, name: &str) -> Option<String> {
    let (whole, part) = match name {
        "scene_share" => (
            include_str!("../wgsl/shared/scene_share_whole.wgsl"),
            include_str!("../wgsl/shared/scene_share_part.wgsl"),
        ),
        _ => return None,
    };
    Some(if stage == SceneStage::SharedPairs { part } else { whole }.to_owned())
}

/// The part of that name of a stage, if what it says depends on whether the frame has rules.
fn rules_part(stage: GridStage, share: Share, name: &str) -> Option<String> {
    let (none, ruled) = match name {
        "box_worlds" => (
            include_str!("../wgsl/shared/box_worlds_none.wgsl"),
            include_str!("../wgsl/shared/box_worlds_ruled.wgsl"),
        ),
        "pair_rules" => (
            include_str!("../wgsl/shared/pair_rules_none.wgsl"),
            include_str!("../wgsl/shared/pair_rules_ruled.wgsl"),
        ),
        "written_worlds" => (
            include_str!("../wgsl/shared/written_worlds_none.wgsl"),
            include_str!("../wgsl/shared/written_worlds_ruled.wgsl"),
        ),
        _ => return None,
    };
    if share != Share::Ruled {
        return Some(none.to_owned());
    }
    let behind = stage.without_rules().binding_count();
    let numbered = ruled.replace("@binding(BEHIND)", &format!("@binding({behind})"));
    Some(numbered.replace("@binding(BEHIND_THAT)", &format!("@binding({})", behind + 1)))
}
