//! What a scene reported, added up and compared with the oracle. Pure.
//!
//! One scene in so many is audited, from its beginning to its end: its edits and answers are copied, and
//! followed in the background by a copy of its boxes and the pairs that its client knows from what it took.
//! After each taken answer some boxes, drawn at random, are compared with all others.

use std::collections::BTreeSet;

use bytemuck::Zeroable;
use pairmask_core::oracle::Corners;
use pairmask_core::scene::{Edit, Report, Reported, SceneCopy};
use pairmask_core::{Aabb, EngineChoice};
use pairmask_wire::{EditLayout, EditScratch, Page, SceneId, SceneRequest, page_count};

use super::NotedName;
use super::check::{Outcome, check};
use super::window::Window;
use crate::scene::Random;

/// Pairs of boxes that are compared after an answer: about 10 ms of the oracle.
const TESTS: usize = 1 << 21;

/// An edit, and what was reported of it.
#[derive(Debug)]
pub struct SceneNote {
    pub name: NotedName,
    pub request: SceneRequest,
    pub payload: Vec<Page>,
    pub reported: Reported,
}

impl SceneNote {
    /// Copies an edit of a scene that several sessions write, and what it changed. Each is taken before the next.
    /// `None` where it has a step of a later core.
    pub fn of_tick(number: u64, edit: Edit<'_>, reported: &Reported) -> Option<Self> {
        let layout = EditLayout::of(edit)?;
        let mut payload = vec![Page::zeroed(); page_count(layout.payload_bytes()) as usize];
        if !layout.write(edit, &mut payload) {
            return None;
        }
        let [boxes, steps, indices] = layout.sections();
        let request = SceneRequest {
            scene: SceneId(0),
            base: number,
            revision: number + 1,
            is_acknowledged: true,
            is_lost: false,
            reported: None,
            report: reported.report(),
            most_boxes: u32::MAX,
            engine: EngineChoice::Auto,
            threads: None,
            boxes,
            steps,
            indices,
        };
        let (name, reported) = (NotedName::Tick(number), reported.clone());
        Some(Self { name, request, payload, reported })
    }
}

#[derive(Debug)]
pub struct SceneAudit {
    copy: SceneCopy,
    /// Pairs that the client knows.
    known: BTreeSet<[u32; 2]>,
    /// The last answer, until the client says that it took it or not.
    open: Option<SceneNote>,
    scratch: EditScratch,
    random: Random,
}

impl SceneAudit {
    pub fn new(most_boxes: u32, seed: u64) -> Self {
        Self {
            copy: SceneCopy::new(most_boxes),
            known: BTreeSet::new(),
            open: None,
            scratch: EditScratch::default(),
            random: Random::new(seed),
        }
    }

    /// Follows an edit. Returns what was compared: the pairs of the answer before, if it was taken.
    /// `None` where the edit cannot be followed: its client changed it after it was answered, or went back to a snapshot
    /// of a scene whose pairs take long to find.
    pub fn follow(&mut self, note: SceneNote) -> Option<Outcome> {
        let outcome = match self.open.take() {
            Some(last) if note.request.is_acknowledged => self.take(&last.reported),
            _ => Outcome::default(),
        };
        let steps = self.scratch.read(&note.request, &note.payload).ok()?;
        let edit = Edit { steps: &steps };
        self.copy.check(edit).ok()?;
        self.copy.apply(edit);
        if note.request.reported.is_some() {
            self.known = self.pairs_of_now()?;
        } else {
            self.open = Some(note);
        }
        Some(outcome)
    }

    /// All pairs, unless there are too many boxes.
    fn pairs_of_now(&self) -> Option<BTreeSet<[u32; 2]>> {
        let end = self.copy.index_end();
        if end * end > TESTS {
            return None;
        }
        let boxes = self.corners();
        let pairs = (0..end as u32).flat_map(|a| (a + 1..end as u32).map(move |b| [a, b]));
        Some(pairs.filter(|pair| self.is_pair(&boxes, *pair)).collect())
    }

    fn is_pair(&self, boxes: &[Corners], pair: [u32; 2]) -> bool {
        let [a, b] = pair.map(|index| &boxes[index as usize]);
        a.overlap(b) && self.copy.states().may_meet(pair)
    }

    fn corners(&self) -> Vec<Corners> {
        (0..self.copy.index_end() as u32).map(|index| Corners::of(&self.box_at(index))).collect()
    }

    /// Compares the answer to a query with the boxes as they are after the last edit.
    pub fn check_query(&self, window: &mut Window) -> Outcome {
        let first = window.fill_second_set(|index| self.box_at(index));
        let rules = self.copy.states().filters.rules();
        check(window, |index, object| {
            let filter_data =
                window.filter_data.as_ref().and_then(|filter_data| filter_data.get(index as usize));
            filter_data.is_none_or(|filter_data| {
                rules.may_meet(filter_data, &self.copy.states().filter_data(object - first))
            })
        })
    }

    /// A box that is on; else one that overlaps nothing.
    fn box_at(&self, index: u32) -> Aabb {
        self.copy
            .snapshot(index)
            .filter(|snapshot| snapshot.is_on)
            .map_or(Aabb::EMPTY, |snapshot| snapshot.b)
    }

    fn take(&mut self, reported: &Reported) -> Outcome {
        let mut outcome = Outcome::default();
        if reported.is_resync() || reported.report() == Report::All {
            self.known = reported.pairs().iter().copied().collect();
        } else if reported.report() == Report::Changes {
            let mut wrong = |is_wrong: bool, [a, b]: [u32; 2]| {
                if is_wrong {
                    outcome.extra += 1;
                    outcome.first.get_or_insert([a, b]);
                }
            };
            for ended in reported.ended() {
                wrong(!self.known.remove(&ended.pair), ended.pair);
            }
            for pair in reported.begun() {
                wrong(!self.known.insert(*pair), *pair);
            }
        } else {
            return outcome;
        }
        self.compare(&mut outcome);
        outcome
    }

    fn compare(&mut self, outcome: &mut Outcome) {
        let end = self.copy.index_end();
        let boxes = self.corners();
        for _ in 0..(TESTS / end.max(1)).max(1).min(end) {
            let row = self.random.below(end as u64) as u32;
            for other in (0..end as u32).filter(|other| *other != row) {
                let is = self.is_pair(&boxes, [row, other]);
                let pair = [row.min(other), row.max(other)];
                outcome.note(is, self.known.contains(&pair), || pair);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::scene::{Ended, Scene, SceneOptions};
    use pairmask_tests::scene_model::{Edits, Grouped};

    use super::*;

    const MOST_BOXES: u32 = 120;

    fn note(edit: Edit<'_>, reported: &Reported, is_acknowledged: bool) -> SceneNote {
        let mut note = SceneNote::of_tick(1, edit, reported).expect("steps of this core");
        note.request.is_acknowledged = is_acknowledged;
        note
    }

    /// Follows edits, the changes of each of which are spoilt.
    fn follow(spoil: impl Fn(&mut Vec<[u32; 2]>, &mut Vec<Ended>)) -> Outcome {
        let mut edits = Edits::new(11, MOST_BOXES);
        let mut scene = Scene::new(SceneOptions::default().with_most_boxes(MOST_BOXES));
        let mut audit = SceneAudit::new(MOST_BOXES, 1);
        let mut random = Random::new(2);
        let (mut sum, mut was_taken) = (Outcome::default(), false);
        for _ in 0..300 {
            let ops = edits.next_edit();
            let grouped = Grouped::of(&ops);
            let edit = Edit { steps: &grouped.steps() };
            let report =
                [Report::Changes, Report::Changes, Report::All, Report::Moved, Report::Nothing];
            let report = report[random.below(5) as usize];
            let mut note = note(edit, scene.edit(edit, report).expect("a right edit"), was_taken);
            if note.reported.report() == Report::Changes && !note.reported.is_resync() {
                let (mut begun, mut ended) = std::mem::take(&mut note.reported).into_changes();
                spoil(&mut begun, &mut ended);
                note.reported = Reported::of_changes(begun, ended, 0);
            }
            let found = audit.follow(note).expect("an edit that can be followed");
            sum.pairs += found.pairs;
            sum.missed += found.missed;
            sum.extra += found.extra;
            was_taken = random.below(3) > 0;
            if was_taken {
                scene.acknowledge();
            }
        }
        sum
    }

    #[test]
    fn changes_that_are_lost_or_made_up_are_found() {
        let right = follow(|_, _| ());
        assert!(right.pairs > 10_000);
        assert_eq!((right.missed, right.extra), (0, 0));
        let most = |len: usize| len.max(4) - 1;
        assert!(follow(|begun, _| begun.truncate(most(begun.len()))).missed > 0);
        assert!(follow(|_, ended| ended.truncate(most(ended.len()))).extra > 0);
        assert!(follow(|begun, _| begun.extend_from_within(..begun.len().min(1))).extra > 0);
    }

    #[test]
    fn an_edit_that_was_changed_afterwards_is_not_followed() {
        let mut audit = SceneAudit::new(MOST_BOXES, 1);
        let mut scene = Scene::new(SceneOptions::default());
        let ops = Edits::new(1, MOST_BOXES).next_edit();
        let grouped = Grouped::of(&ops);
        let edit = Edit { steps: &grouped.steps() };
        let reported = scene.edit(edit, Report::All).expect("a right edit");
        let mut wrong = note(edit, reported, false);
        bytemuck::cast_slice_mut::<Page, u32>(&mut wrong.payload).fill(u32::MAX);
        assert!(audit.follow(wrong).is_none());
        assert_eq!(audit.copy.get(0), None::<Aabb>);
    }
}
