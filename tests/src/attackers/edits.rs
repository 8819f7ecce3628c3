//! A client that forges edits of scenes, and changes them while the daemon reads them.

use bytemuck::cast_slice_mut;
use pairmask_core::engine::EngineChoice;
use pairmask_core::filters::{Filter, FilterId, FilterTable, Owner, Tag, World};
use pairmask_core::scene::{Edit, Step, Tags, Want};
use pairmask_wire::{EditLayout, Page, RequestHeader, SceneId, SceneRequest, page_count};

use super::raw::{Dice, RawClient};
use super::{Tally, Until, send_and_spoil};
use crate::scene_edits::{EditMaker, SKIPPED};

/// Pages of a request.
const PAGES: usize = 16;
/// Boxes of its scenes.
const MOST_BOXES: usize = 600;
/// Its token.
const TOKEN: u64 = 1 << 45;

pub(super) fn attack(until: &Until, tally: &mut Tally) {
    let mut dice = Dice::of_this_process();
    let mut revision = 0;
    while !until.is_over() {
        let Some(client) = RawClient::reconnect(TOKEN, PAGES, until) else { return };
        let mut source = EditMaker::new(dice.below(u64::MAX), MOST_BOXES);
        let mut base = 0;
        for frame in 0..2_000 {
            if until.is_over() {
                break;
            }
            revision += 1;
            let owned = source.next_edit();
            let arrays = owned.arrays(dice.below(3) as usize);
            let mut steps = arrays.steps();
            let rules = RuleSteps::drawn(&mut dice);
            if dice.below(3) == 0 {
                rules.add_to(&mut steps, &mut dice);
            }
            let edit = Edit { steps: &steps };
            let Some(layout) = EditLayout::of(edit) else { continue };
            if page_count(layout.payload_bytes()) as usize > PAGES {
                continue;
            }
            let Some(mut loan) = client.loan(PAGES) else { break };
            let _ = layout.write(edit, loan.payload_mut());
            let [boxes, steps, indices] = layout.sections();
            let request = SceneRequest {
                scene: SceneId(dice.below(3) as u32),
                base,
                revision,
                is_taken: dice.below(2) == 0,
                is_lost: dice.below(9) == 0,
                want: [Want::Changes, Want::Moved, Want::All, Want::Nothing]
                    [dice.below(4) as usize],
                most_boxes: MOST_BOXES as u32 + SKIPPED,
                engine: EngineChoice::Auto,
                threads: None,
                boxes,
                steps,
                indices,
            };
            let mut header = RequestHeader::edit_scene(TOKEN, frame, &request);
            let is_forged = dice.below(3) > 0;
            if is_forged {
                forge(&mut header, loan.payload_mut(), &mut dice);
            }
            *loan.user_header_mut() = header;
            let Some(answered) = send_and_spoil(&client, loan, is_forged, &mut dice, tally) else {
                break;
            };
            // A scene that was forged is begun anew now and then.
            base = if answered.status == 0 && dice.below(20) > 0 { header.revision } else { 0 };
        }
    }
}

/// Steps about rules, most of them of boxes that there are.
struct RuleSteps {
    indices: Vec<u32>,
    tags: Vec<Tag>,
    table: FilterTable,
    pairs: Vec<[u32; 2]>,
}

impl RuleSteps {
    fn drawn(dice: &mut Dice) -> Self {
        let index = |dice: &mut Dice| {
            let end = dice.below(30) + 1;
            dice.below(end) as u32
        };
        let indices: Vec<u32> = (0..dice.below(4)).map(|_| index(dice)).collect();
        let tag = |dice: &mut Dice| {
            let (world, owner) = (World(dice.below(4) as i32 - 1), Owner(dice.below(3) as u32));
            Tag::new(world, owner, FilterId(dice.below(5) as u16)).with_static(dice.below(2) == 0)
        };
        let filter = |dice: &mut Dice| {
            let filter = Filter::new(dice.below(4), dice.below(4));
            filter.with_group(dice.below(3) as i32 - 1).with_static(dice.below(3) == 0)
        };
        let filters: Vec<Filter> = (0..dice.below(5)).map(|_| filter(dice)).collect();
        Self {
            tags: indices.iter().map(|_| tag(dice)).collect(),
            indices,
            table: FilterTable::new(&filters).unwrap_or_default(),
            pairs: (0..dice.below(4)).map(|_| [index(dice), index(dice)]).collect(),
        }
    }

    fn add_to<'a>(&'a self, steps: &mut Vec<Step<'a>>, dice: &mut Dice) {
        let indices = (&self.indices).into();
        steps.push(Step::Tag(Tags { indices, tags: &self.tags }));
        for step in [
            Step::Filters(&self.table),
            Step::Include(&self.pairs, dice.below(2) == 0),
            Step::Exclude(&self.pairs, dice.below(2) == 0),
        ] {
            if dice.below(3) == 0 {
                steps.push(step);
            }
        }
    }
}

/// Changes some words of a request.
fn forge(header: &mut RequestHeader, payload: &mut [Page], dice: &mut Dice) {
    let some = |dice: &mut Dice| (dice.below(u64::MAX) >> dice.below(64)) as u32;
    for _ in 0..dice.below(3) {
        let words: &mut [u32] = bytemuck::cast_slice_mut(bytemuck::bytes_of_mut(header));
        // Behind magic, version and operation, and the token.
        let place = 8 + dice.below(words.len() as u64 - 8) as usize;
        words[place] = some(dice);
    }
    let words: &mut [u32] = cast_slice_mut(payload);
    for _ in 0..dice.below(6) {
        // Steps, indices and boxes lie in the first pages.
        let place = dice.below(4 * size_of::<Page>() as u64 / 4) as usize;
        words[place] = some(dice);
    }
}
