//! A client that forges requests about shared scenes: it joins, leases, commits, asks and leaves in any order, under
//! any number, and leaves commits unanswered.

use std::time::Duration;

use bytemuck::cast_slice_mut;
use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::shared::{AtEnd, Scope};
use pairmask_core::scene::{Edit, QueryFilterData, QueryMask};
use pairmask_core::{Aabb, Encoding};
use pairmask_wire::{
    EditLayout, JoinRequest, LeaseAction, LeaseRequest, QueryRequest, RequestHeader, SceneId,
    Section, SectionKind, SharedTerms, page_count,
};

use super::{Forging, Tally, Until, scene_request};
use crate::scene_model::{Edits, Grouped};

const MOST_BOXES: u32 = 200;
pub const SHARED_SCENE: &str = "attacked";

const FORGING: Forging = Forging {
    token: 1 << 46,
    pages: 8,
    requests: 300,
    forged_of_four: 1,
    payload_words: 0,
    given_up: 10,
};

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut revisions = [0u64; 3];
    let mut source = Edits::new(0, MOST_BOXES);
    FORGING.attack(until, tally, |_, dice, payload, frame, _| {
        if frame == 0 {
            source = Edits::new(dice.below(u64::MAX), MOST_BOXES);
        }
        let number = dice.below(3) as u32;
        let scene = SceneId(number);
        let revision = &mut revisions[number as usize];
        Some(match dice.below(8) {
            0 => {
                // Scenes of its own, and the one of others.
                let names = [SHARED_SCENE, "own", "not a name"];
                let name = names[dice.below(3) as usize];
                let payload: &mut [u8] = cast_slice_mut(payload);
                payload[..name.len()].copy_from_slice(name.as_bytes());
                let kept = if dice.below(2) == 0 { None } else { Some(AtEnd::Keep) };
                let is_own = name == "own";
                let terms = SharedTerms {
                    most_boxes: is_own.then_some(MOST_BOXES),
                    deadline: is_own.then_some(Duration::from_nanos(1 + dice.below(1 << 20))),
                    at_end: kept.filter(|_| is_own),
                };
                let request = JoinRequest {
                    scene,
                    name: Section::required(SectionKind::SceneName, 0, name.len() as u64),
                    terms,
                    scope: if dice.below(2) == 0 { Scope::All } else { Scope::Own },
                    engine: EngineChoice::Auto,
                };
                *revision = 0;
                RequestHeader::join_shared(FORGING.token, frame, &request)
            }
            1 | 2 => {
                let (first, count) = (dice.below(300) as u32, dice.below(100) as u32);
                let action = match dice.below(3) {
                    0 => LeaseAction::Take { first: 1_000 + first, count },
                    1 => LeaseAction::TakeAny { count },
                    _ => LeaseAction::GiveBack { first },
                };
                let request = LeaseRequest { scene, action };
                RequestHeader::lease_shared(FORGING.token, frame, &request)
            }
            3 if dice.below(4) == 0 => RequestHeader::leave_shared(FORGING.token, frame, scene),
            3 => {
                // Of all indices that there may be, or of too few.
                let mask = QueryMask::new(1, [10, 2_000][dice.below(2) as usize])?;
                let encoding = Encoding::ALL[dice.below(3) as usize];
                let request =
                    QueryRequest::new(scene, None, mask, encoding, &QueryFilterData::None);
                let _ = request.write(
                    &[Aabb::new([-9.0; 3], [9.0; 3])],
                    &QueryFilterData::None,
                    payload,
                );
                RequestHeader::query_scene(FORGING.token, frame, &request)
            }
            _ => {
                let ops = source.next_edit();
                let grouped = Grouped::of(&ops);
                let steps = grouped.steps();
                let edit = Edit { steps: if dice.below(2) == 0 { &steps } else { &[] } };
                let layout = EditLayout::of(edit)?;
                if page_count(layout.payload_bytes()) as usize > FORGING.pages {
                    return None;
                }
                let _ = layout.write(edit, payload);
                let revisions = [*revision, *revision + 1];
                *revision += 1;
                let request = scene_request(dice, [number, MOST_BOXES], revisions, &layout);
                RequestHeader::commit_shared(FORGING.token, frame, &request)
            }
        })
    });
}
