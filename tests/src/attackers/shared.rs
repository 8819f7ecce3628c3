//! A client that forges requests about shared scenes: it joins, leases, commits and leaves in any order, under
//! any number, and leaves commits unanswered.

use std::time::Duration;

use bytemuck::cast_slice_mut;
use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::shared::{AtEnd, Hears};
use pairmask_core::scene::{Edit, Want};
use pairmask_wire::{
    EditLayout, JoinRequest, LeaseAction, LeaseRequest, RequestHeader, SceneId, SceneRequest,
    Section, SectionKind, SharedTerms, page_count,
};

use super::raw::{Dice, RawClient, answer};
use super::{Tally, Until, count};
use crate::scene_edits::{EditMaker, SKIPPED};

/// Pages of a request.
const PAGES: usize = 8;
/// Boxes of its scenes.
const MOST_BOXES: u32 = 200;
/// Its token.
const TOKEN: u64 = 1 << 46;
/// The scene of the honest members beside it.
pub const SHARED_SCENE: &str = "attacked";

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut dice = Dice::of_this_process();
    let mut revisions = [0u64; 3];
    while !until.is_over() {
        let Some(client) = RawClient::reconnect(TOKEN, PAGES, until) else { return };
        let mut source = EditMaker::new(dice.below(u64::MAX), MOST_BOXES as usize);
        for frame in 0..300 {
            if until.is_over() {
                return;
            }
            let number = dice.below(3) as u32;
            let scene = SceneId(number);
            let revision = &mut revisions[number as usize];
            let Some(mut loan) = client.loan(PAGES) else { break };
            let mut header = match dice.below(8) {
                0 => {
                    // Scenes of its own, and the one of others.
                    let names = [SHARED_SCENE, "own", "not a name"];
                    let name = names[dice.below(3) as usize];
                    let payload: &mut [u8] = cast_slice_mut(loan.payload_mut());
                    payload[..name.len()].copy_from_slice(name.as_bytes());
                    let kept = if dice.below(2) == 0 { None } else { Some(AtEnd::Keep) };
                    let is_own = name == "own";
                    let terms = SharedTerms {
                        most_boxes: is_own.then_some(MOST_BOXES + SKIPPED),
                        deadline: is_own.then_some(Duration::from_nanos(1 + dice.below(1 << 20))),
                        at_end: kept.filter(|_| is_own),
                    };
                    let request = JoinRequest {
                        scene,
                        name: Section::required(SectionKind::SceneName, 0, name.len() as u64),
                        terms,
                        hears: if dice.below(2) == 0 { Hears::All } else { Hears::Own },
                        engine: EngineChoice::Auto,
                    };
                    *revision = 0;
                    RequestHeader::join_shared(TOKEN, frame, &request)
                }
                1 | 2 => {
                    let (first, count) = (dice.below(300) as u32, dice.below(100) as u32);
                    let action = match dice.below(3) {
                        0 => LeaseAction::Take { first: 1_000 + first, count },
                        1 => LeaseAction::TakeAny { count },
                        _ => LeaseAction::GiveBack { first },
                    };
                    RequestHeader::lease_shared(TOKEN, frame, &LeaseRequest { scene, action })
                }
                3 if dice.below(4) == 0 => RequestHeader::leave_shared(TOKEN, frame, scene),
                _ => {
                    let owned = source.next_edit();
                    let arrays = owned.arrays(dice.below(3) as usize);
                    let steps = arrays.steps();
                    let edit = Edit { steps: if dice.below(2) == 0 { &steps } else { &[] } };
                    let Some(layout) = EditLayout::of(edit) else { continue };
                    if page_count(layout.payload_bytes()) as usize > PAGES {
                        continue;
                    }
                    let _ = layout.write(edit, loan.payload_mut());
                    let [boxes, steps, indices] = layout.sections();
                    let base = *revision;
                    *revision += 1;
                    let request = SceneRequest {
                        scene,
                        base,
                        revision: *revision,
                        is_taken: dice.below(2) == 0,
                        is_lost: dice.below(9) == 0,
                        want: [Want::Changes, Want::Moved, Want::All, Want::Nothing]
                            [dice.below(4) as usize],
                        most_boxes: MOST_BOXES,
                        engine: EngineChoice::Auto,
                        threads: None,
                        boxes,
                        steps,
                        indices,
                    };
                    RequestHeader::commit_shared(TOKEN, frame, &request)
                }
            };
            if dice.below(4) == 0 {
                let words: &mut [u32] = cast_slice_mut(bytemuck::bytes_of_mut(&mut header));
                // Behind magic, version and operation, and the token.
                let place = 8 + dice.below(words.len() as u64 - 8) as usize;
                words[place] = (dice.below(u64::MAX) >> dice.below(64)) as u32;
            }
            *loan.user_header_mut() = header;
            let Some(pending) = client.send(loan) else { break };
            if dice.below(10) == 0 {
                count(tally, "given up");
                continue;
            }
            let Some(answered) = answer(&pending, Duration::from_secs(2)) else {
                count(tally, "unanswered");
                break;
            };
            count(tally, if answered.status == 0 { "answered" } else { "refused" });
        }
    }
}
