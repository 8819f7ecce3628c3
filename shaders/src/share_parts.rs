//! The parts of stages that differ by how much of a search a GPU does, and by whether a frame has rules.

use crate::compose::{GridStage, Rules, SceneStage, Stage};

/// The part of that name of a stage, if what it says depends on the share or on rules. Frames of spheres have no rules.
pub(crate) fn share_part(stage: Stage, name: &str) -> Option<String> {
    match stage {
        Stage::Grid(stage) => rules_part(stage, name),
        Stage::Scene(stage) => scene_part(stage, name),
        _ => None,
    }
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
fn rules_part(stage: GridStage, name: &str) -> Option<String> {
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
    let (GridStage::Cells(_, Rules::With)
    | GridStage::Pairs(_, Rules::With)
    | GridStage::Write(_, Rules::With)) = stage
    else {
        return Some(none.to_owned());
    };
    let behind = stage.without_rules().binding_count();
    let numbered = ruled.replace("@binding(BEHIND)", &format!("@binding({behind})"));
    Some(numbered.replace("@binding(BEHIND_THAT)", &format!("@binding({})", behind + 1)))
}
