//! The parts of stages that differ by how much of a frame a GPU does.

use crate::compose::{GridStage, Share, Stage};

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
    let (whole, part) = match (name, stage) {
        ("share_boxes", GridStage::Cells(..) | GridStage::SphereCells) => (
            include_str!("../wgsl/shared/share_boxes_whole.wgsl"),
            include_str!("../wgsl/shared/share_boxes_part.wgsl"),
        ),
        ("share_rows", GridStage::Pairs(..) | GridStage::SpherePairs(_) | GridStage::Write(..)) => {
            (
                include_str!("../wgsl/shared/share_rows_whole.wgsl"),
                include_str!("../wgsl/shared/share_rows_part.wgsl"),
            )
        }
        ("share_noted", GridStage::Pairs(..) | GridStage::SpherePairs(_)) => (
            include_str!("../wgsl/shared/share_noted_whole.wgsl"),
            include_str!("../wgsl/shared/share_noted_part.wgsl"),
        ),
        _ => return None,
    };
    Some(if share == Share::Whole { whole } else { part }.to_owned())
}
