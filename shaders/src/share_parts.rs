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
    let is_ruled = matches!(
        stage,
        GridStage::Cells(_, Rules::With)
            | GridStage::Pairs(_, Rules::With)
            | GridStage::Write(_, Rules::With)
    );
    Some(if is_ruled { ruled } else { none }.to_owned())
}

/// Numbers the bindings of rules, which come behind all others of a stage.
pub(crate) fn number_behind(text: &str) -> String {
    let count = |what| text.matches(what).count();
    let behind = count("@binding(") - count("@binding(BEHIND");
    let numbered = text.replace("@binding(BEHIND)", &format!("@binding({behind})"));
    numbered.replace("@binding(BEHIND_THAT)", &format!("@binding({})", behind + 1))
}
