//! A client that forges edits of scenes, and changes them while the daemon reads them.

use pairmask_core::scene::Edit;
use pairmask_wire::{EditLayout, RequestHeader, page_count};

use super::{Forging, Tally, Until, scene_request};
use crate::scene_model::{Edits, Grouped};

const MOST_BOXES: u32 = 600;

const FORGING: Forging = Forging::new(1 << 45, 16);

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
        // A scene that was forged is begun anew now and then.
        let goes_on = |(_, answered): &&(_, pairmask_wire::ResponseHeader)| answered.status == 0;
        let base = last.filter(goes_on).map_or(0, |(header, _)| header.revision);
        let base = if dice.below(20) > 0 { base } else { 0 };
        let of = [dice.below(3) as u32, MOST_BOXES];
        let request = scene_request(dice, of, [base, revision], &layout);
        Some(RequestHeader::edit_scene(FORGING.token, frame, &request))
    });
}
