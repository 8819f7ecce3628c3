//! A client that forges rules of frames, and changes them while the daemon reads them.

use bytemuck::{cast_slice, cast_slice_mut};
use pairmask_core::aabb::Aabb;
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;
use pairmask_wire::{CullRequest, Page, RequestHeader, RulesLayout, ScenePlace, page_count};

use super::raw::{Dice, RawClient};
use super::{Tally, Until, send_and_spoil};
use crate::filtered_frames::{FilteredFrame, KINDS};

/// Pages of a request.
const PAGES: usize = 8;
/// Its token.
const TOKEN: u64 = 1 << 46;
/// Frames that are drawn; each is sent often, forged in other ways.
const FRAMES: u64 = 24;

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut dice = Dice::of_this_process();
    let frames: Vec<FilteredFrame> = (0..FRAMES)
        .map(|_| {
            let kind = KINDS[dice.below(KINDS.len() as u64) as usize];
            FilteredFrame::drawn(dice.below(300) as usize, kind, dice.below(u64::MAX))
        })
        .collect();
    while !until.is_over() {
        let Some(client) = RawClient::reconnect(TOKEN, PAGES, until) else { return };
        for number in 0..2_000 {
            if until.is_over() {
                break;
            }
            let frame = &frames[dice.below(FRAMES) as usize];
            let scene = ScenePlace::first(BoxForm::F32, BoxCount::new(frame.boxes.len() as u32));
            let layout = RulesLayout::of(&frame.rules, scene.count, scene.payload_bytes());
            let Ok(layout) = layout else { continue };
            if page_count(layout.payload_bytes()) as usize > PAGES {
                continue;
            }
            let Some(mut loan) = client.loan(PAGES) else { break };
            let boxes: &[u8] = cast_slice::<Aabb, u8>(&frame.boxes);
            cast_slice_mut::<Page, u8>(loan.payload_mut())[..boxes.len()].copy_from_slice(boxes);
            let _ = layout.write(&frame.rules, loan.payload_mut());
            let may_repeat = dice.below(2) == 0;
            let rules = Some(layout.place());
            let request = CullRequest { rules, may_repeat, ..CullRequest::of(scene) };
            let mut header = RequestHeader::cull(TOKEN, number, &request);
            let is_forged = dice.below(4) > 0;
            if is_forged {
                forge(&mut header, loan.payload_mut(), &mut dice);
            }
            *loan.user_header_mut() = header;
            if send_and_spoil(&client, loan, is_forged, &mut dice, tally).is_none() {
                break;
            }
        }
    }
}

/// Changes some words of a request.
fn forge(header: &mut RequestHeader, payload: &mut [Page], dice: &mut Dice) {
    let some = |dice: &mut Dice| (dice.below(u64::MAX) >> dice.below(64)) as u32;
    for _ in 0..dice.below(3) {
        let words: &mut [u32] = cast_slice_mut(bytemuck::bytes_of_mut(header));
        // Behind magic, version and operation, and the token.
        let place = 8 + dice.below(words.len() as u64 - 8) as usize;
        words[place] = some(dice);
    }
    let words: &mut [u32] = cast_slice_mut(payload);
    for _ in 0..dice.below(9) {
        let place = dice.below(words.len() as u64) as usize;
        words[place] = some(dice);
    }
}
