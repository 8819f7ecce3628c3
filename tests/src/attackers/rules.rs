//! A client that forges rules of frames, and changes them while the daemon reads them.

use bytemuck::{cast_slice, cast_slice_mut};
use pairmask_core::aabb::Aabb;
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;
use pairmask_wire::{CullRequest, Page, RequestHeader, RulesLayout, SceneSections, page_count};

use super::raw::dice;
use super::{Forging, Tally, Until};
use crate::filtered_frames::{FilteredFrame, KINDS};

/// Frames that are drawn; each is sent often, forged in other ways.
const FRAMES: u64 = 24;

const FORGING: Forging = Forging { payload_words: 8, ..Forging::new(1 << 46, 8) };

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut dice = dice();
    let frames: Vec<FilteredFrame> = (0..FRAMES)
        .map(|_| {
            let kind = KINDS[dice.below(KINDS.len() as u64) as usize];
            FilteredFrame::drawn(dice.below(300) as usize, kind, dice.below(u64::MAX))
        })
        .collect();
    FORGING.attack(until, tally, |_, dice, payload, number, _| {
        let frame = &frames[dice.below(FRAMES) as usize];
        let scene = SceneSections::first(BoxForm::F32, BoxCount::new(frame.boxes.len() as u32));
        let layout = RulesLayout::of(&frame.rules, scene.count, scene.payload_bytes()).ok()?;
        if page_count(layout.payload_bytes()) as usize > FORGING.pages {
            return None;
        }
        let boxes: &[u8] = cast_slice::<Aabb, u8>(&frame.boxes);
        cast_slice_mut::<Page, u8>(payload)[..boxes.len()].copy_from_slice(boxes);
        let _ = layout.write(&frame.rules, payload);
        let (rules, may_repeat) = (Some(layout.sections()), dice.below(2) == 0);
        let request = CullRequest { rules, may_repeat, ..CullRequest::of(scene) };
        Some(RequestHeader::cull(FORGING.token, number, &request))
    });
}
