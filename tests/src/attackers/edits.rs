//! A client that forges edits of scenes, and changes them while the daemon reads them.

use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::{Edit, Want};
use pairmask_wire::{EditLayout, RequestHeader, SceneId, SceneRequest, page_count};

use super::{Forging, Tally, Until};
use crate::scene_model::{Edits, Grouped};

/// Boxes of its scenes.
const MOST_BOXES: u32 = 600;

const FORGING: Forging = Forging {
    token: 1 << 45,
    pages: 16,
    requests: 2_000,
    forged_of_four: 3,
    payload_words: 5,
    given_up: 0,
};

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let (mut revision, mut source) = (0, Edits::new(0, MOST_BOXES));
    FORGING.attack(until, tally, |_, dice, payload, frame, last| {
        if frame == 0 {
            source = Edits::new(dice.below(u64::MAX), MOST_BOXES);
        }
        revision += 1;
        let ops = source.next_edit();
        let grouped = Grouped::of(&ops);
        let edit = Edit { steps: &grouped.steps() };
        let layout = EditLayout::of(edit)?;
        if page_count(layout.payload_bytes()) as usize > FORGING.pages {
            return None;
        }
        let _ = layout.write(edit, payload);
        let [boxes, steps, indices] = layout.sections();
        // A scene that was forged is begun anew now and then.
        let goes_on = |(_, answered): &&(_, pairmask_wire::ResponseHeader)| answered.status == 0;
        let base = last.filter(goes_on).map_or(0, |(header, _)| header.revision);
        let request = SceneRequest {
            scene: SceneId(dice.below(3) as u32),
            base: if dice.below(20) > 0 { base } else { 0 },
            revision,
            is_taken: dice.below(2) == 0,
            is_lost: dice.below(9) == 0,
            want: [Want::Changes, Want::Moved, Want::All, Want::Nothing][dice.below(4) as usize],
            most_boxes: MOST_BOXES,
            engine: EngineChoice::Auto,
            threads: None,
            boxes,
            steps,
            indices,
        };
        Some(RequestHeader::edit_scene(FORGING.token, frame, &request))
    });
}
