//! A client that forges queries of a scene and frames of two sets, and changes them while the daemon reads
//! them.

use std::time::Duration;

use bytemuck::{cast_slice, cast_slice_mut};
use pairmask_core::engine::EngineChoice;
use pairmask_core::filters::Tag;
use pairmask_core::precision::BoxForm;
use pairmask_core::scene::{Edit, QueryMask, QueryTags, Sets, Step, Want};
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmask_wire::{
    CullRequest, EditLayout, Page, QueryRequest, RequestHeader, SceneId, ScenePlace, SceneRequest,
};

use super::raw::{Dice, RawClient, answer};
use super::{Tally, Until, send_and_spoil};

/// Pages of a request.
const PAGES: usize = 16;
/// Boxes of its scene, of a few queries, and of a frame.
const BOXES: u32 = 300;
/// Its token.
const TOKEN: u64 = 1 << 46;
const SCENE: SceneId = SceneId(1);

fn a_box(dice: &mut Dice) -> Aabb {
    let min = [(); 3].map(|()| dice.below(12) as f32);
    Aabb::new(min, min.map(|x| x + dice.below(3) as f32))
}

fn boxes(dice: &mut Dice, count: u32) -> Vec<Aabb> {
    (0..count).map(|_| a_box(dice)).collect()
}

/// A scene of the revision, whole.
fn edit(client: &RawClient, dice: &mut Dice, revision: u64) -> Option<bool> {
    let boxes = boxes(dice, BOXES);
    let steps = [Step::Set(Sets { indices: (0..BOXES).into(), boxes: &boxes })];
    let edit = Edit { steps: &steps };
    let layout = EditLayout::of(edit)?;
    let mut loan = client.loan(PAGES)?;
    let _ = layout.write(edit, loan.payload_mut());
    let [boxes, steps, indices] = layout.sections();
    let request = SceneRequest {
        scene: SCENE,
        base: 0,
        revision,
        is_taken: false,
        is_lost: false,
        want: Want::Nothing,
        most_boxes: BOXES,
        engine: EngineChoice::Auto,
        threads: None,
        boxes,
        steps,
        indices,
    };
    *loan.user_header_mut() = RequestHeader::edit_scene(TOKEN, revision, &request);
    let answered = answer(&client.send(loan)?, Duration::from_secs(2))?;
    Some(answered.status == 0)
}

/// A query or a frame of two sets, as it should be, in the payload.
fn request(dice: &mut Dice, frame: u64, revision: u64, payload: &mut [Page]) -> RequestHeader {
    let count = dice.below(70) as u32;
    if dice.below(3) == 0 {
        let n = BoxCount::new(BOXES);
        let bytes: &mut [u8] = cast_slice_mut(payload);
        let boxes = boxes(dice, BOXES);
        bytes[..24 * boxes.len()].copy_from_slice(cast_slice(&boxes));
        let scene = ScenePlace::first(BoxForm::F32, n);
        let first_set = Some(BoxCount::new(count));
        let request = CullRequest { first_set, ..CullRequest::of(scene) };
        return RequestHeader::cull(TOKEN, frame, &request);
    }
    let tags = vec![Tag::default(); count as usize];
    let tags = match dice.below(3) {
        0 => QueryTags::None,
        1 => QueryTags::One(Tag::default()),
        _ => QueryTags::Each(&tags),
    };
    let encoding = Encoding::ALL[dice.below(3) as usize];
    let mask = QueryMask::new(count as usize, BOXES).expect("few objects");
    let request = QueryRequest::new(SCENE, revision, mask, encoding, &tags);
    let _ = request.write(&boxes(dice, count), &tags, payload);
    RequestHeader::query_scene(TOKEN, frame, &request)
}

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut dice = Dice::of_this_process();
    let mut revision = 0;
    while !until.is_over() {
        let Some(client) = RawClient::reconnect(TOKEN, PAGES, until) else { return };
        for frame in 0..2_000 {
            if until.is_over() {
                break;
            }
            if frame % 100 == 0 {
                revision += 1;
                if edit(&client, &mut dice, revision).is_none() {
                    break;
                }
            }
            let Some(mut loan) = client.loan(PAGES) else { break };
            let mut header = request(&mut dice, frame, revision, loan.payload_mut());
            let is_forged = dice.below(3) > 0;
            if is_forged {
                let words: &mut [u32] = cast_slice_mut(bytemuck::bytes_of_mut(&mut header));
                for _ in 0..dice.below(3) {
                    // Behind magic, version and operation, and the token.
                    let place = 8 + dice.below(words.len() as u64 - 8) as usize;
                    words[place] = (dice.below(u64::MAX) >> dice.below(64)) as u32;
                }
            }
            *loan.user_header_mut() = header;
            if send_and_spoil(&client, loan, is_forged, &mut dice, tally).is_none() {
                break;
            }
        }
    }
}
