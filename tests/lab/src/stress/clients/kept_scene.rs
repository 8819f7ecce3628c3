//! A scene that persists, as a client edits it: its boxes come from cases, its answers are taken, dropped or
//! never awaited by chance, and each is compared with a naive model.

use std::collections::{BTreeMap, BTreeSet};

use pairmask::scene::{EndReason, Ended, Indices, SceneOptions, Want};
use pairmask::{Aabb, CommitError, Scene, ServedBy, Session};
use pairmask_core::oracle::{Pair, truth};
use pairmaskd::scene::Random;

use crate::stress::case::Case;
use crate::stress::subject::{Finding, compare};

/// Most boxes of most scenes: the model compares each box with all others after every edit.
const FEW_BOXES: usize = 250;
/// Most boxes of one scene in [`MANY_ONE_IN`].
const MANY_BOXES: usize = 2_000;
const MANY_ONE_IN: u64 = 8;
/// Indices beyond the boxes of a case that are in use now and then.
const SPARE: usize = 8;

const WANTS: [Want; 6] =
    [Want::Changes, Want::Changes, Want::Changes, Want::Moved, Want::All, Want::Nothing];

/// A scene of a session, and what has to come of it.
pub(super) struct KeptScene {
    scene: Scene,
    model: Model,
    most: usize,
}

/// What came of an edit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edited {
    /// The answer was right.
    Right(ServedBy),
    /// Nobody waited for it.
    Unread,
}

/// Why an edit failed. The scene is of no further use.
#[derive(Debug)]
pub(super) enum EditFailure {
    /// There is no answer.
    Unanswered(CommitError),
    /// The answer is wrong.
    Wrong(Finding),
}

impl KeptScene {
    /// A scene without boxes.
    pub(super) fn new(session: &mut Session, random: &mut Random) -> Self {
        let most = if random.below(MANY_ONE_IN) == 0 { MANY_BOXES } else { FEW_BOXES };
        let options = SceneOptions::default().with_most_boxes((most + SPARE) as u32);
        Self { scene: session.scene(options), model: Model::default(), most }
    }

    /// Edits it towards the boxes of a case, and compares the answer, on a thread with the floating-point
    /// flags of the case's caller.
    pub(super) fn edit(&mut self, case: &Case, random: &mut Random) -> Result<Edited, EditFailure> {
        let boxes = &case.boxes[..case.boxes.len().min(self.most)];
        let edit = ListedEdit::draw(&self.model, boxes, random);
        let want = WANTS[random.below(WANTS.len() as u64) as usize];
        let fate = match random.below(8) {
            0 => Fate::Unread,
            1..=2 => Fate::Dropped,
            _ => Fate::Taken,
        };
        let scene = &mut self.scene;
        let answer = case.flags.caller.run(|| send(scene, &edit, want, fate));
        let answer = answer.map_err(EditFailure::Unanswered)?;
        self.model.apply(&edit);
        let Some(answer) = answer else { return Ok(Edited::Unread) };
        self.model.check(&answer, &edit.named()).map_err(EditFailure::Wrong)?;
        if fate == Fate::Taken {
            self.model.take(answer.want);
        }
        Ok(Edited::Right(answer.served_by))
    }
}

/// What a client does about an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Taken,
    Dropped,
    Unread,
}

/// An answer, decoded.
#[derive(Clone, Debug)]
struct Answer {
    want: Want,
    is_resync: bool,
    begun: Vec<[u32; 2]>,
    ended: Vec<Ended>,
    pairs: Vec<[u32; 2]>,
    pair_count: Option<u64>,
    served_by: ServedBy,
}

fn send(
    scene: &mut Scene,
    edit: &ListedEdit,
    want: Want,
    fate: Fate,
) -> Result<Option<Answer>, CommitError> {
    let ListedEdit { removed, set, boxes, off, on, fixed, loose } = edit;
    let mask = edit.as_mask();
    let sets = mask.as_ref().map_or(Indices::List(set), |words| Indices::Mask { first: 0, words });
    let edit = scene
        .edit()
        .remove_all(removed)
        .set_all(sets, boxes)
        .switch_all(off, false)
        .switch_all(on, true)
        .make_all_static(fixed, true)
        .make_all_static(loose, false);
    let pending = edit.submit(want)?;
    if fate == Fate::Unread {
        return Ok(None);
    }
    let mut answer = pending.wait()?;
    if fate == Fate::Taken {
        answer = answer.take();
    }
    Ok(Some(Answer {
        want: answer.want(),
        is_resync: answer.is_resync(),
        begun: answer.begun().to_vec(),
        ended: answer.ended().to_vec(),
        pairs: answer.pairs().to_vec(),
        pair_count: answer.pair_count(),
        served_by: answer.served_by(),
    }))
}

/// An edit by lists of indices, each of which rises.
#[derive(Clone, Debug, Default)]
struct ListedEdit {
    removed: Vec<u32>,
    set: Vec<u32>,
    boxes: Vec<Aabb>,
    off: Vec<u32>,
    on: Vec<u32>,
    /// Become static.
    fixed: Vec<u32>,
    /// Are static no more.
    loose: Vec<u32>,
}

impl ListedEdit {
    fn draw(model: &Model, boxes: &[Aabb], random: &mut Random) -> Self {
        let mut edit = Self::default();
        let n = boxes.len() as u64;
        // All, some or few of the indices take part.
        let one_in = [1, 4, 30, 100][random.below(4) as usize];
        for index in 0..(boxes.len() + SPARE) as u32 {
            if random.below(one_in) > 0 {
                continue;
            }
            let mut is_there = model.bodies.contains_key(&index);
            if is_there && random.below(8) == 0 {
                edit.removed.push(index);
                is_there = false;
            }
            if n > 0 && random.below(3) > 0 {
                let from =
                    if random.below(3) == 0 { random.below(n) } else { u64::from(index) % n };
                edit.set.push(index);
                edit.boxes.push(boxes[from as usize]);
                is_there = true;
            }
            if is_there {
                match random.below(40) {
                    0 => edit.off.push(index),
                    1 => edit.on.push(index),
                    2 => edit.fixed.push(index),
                    3 => edit.loose.push(index),
                    _ => {}
                }
            }
        }
        // Boxes of a larger case before.
        let beyond = model.bodies.range((boxes.len() + SPARE) as u32..).map(|(index, _)| *index);
        edit.removed.extend(beyond);
        edit
    }

    /// The boxes that the edit set, switched or flagged.
    fn named(&self) -> BTreeSet<u32> {
        let Self { set, off, on, fixed, loose, .. } = self;
        [set, off, on, fixed, loose].into_iter().flatten().copied().collect()
    }

    /// The boxes that are set as bits, where that is the shorter way to name them.
    fn as_mask(&self) -> Option<Vec<u32>> {
        let words = *self.set.last()? as usize / 32 + 1;
        let mut mask = vec![0u32; words];
        for index in &self.set {
            mask[*index as usize / 32] |= 1 << (index % 32);
        }
        (words < self.set.len()).then_some(mask)
    }
}

#[derive(Clone, Copy, Debug)]
struct Body {
    b: Aabb,
    on: bool,
    is_static: bool,
}

/// The scene as it has to be: bodies, all their pairs, and those that the client knows.
#[derive(Clone, Debug, Default)]
struct Model {
    bodies: BTreeMap<u32, Body>,
    pairs: BTreeSet<Pair>,
    /// Pairs of the last answer that was taken and tells of all.
    told: BTreeSet<Pair>,
    /// Indices that lost a box since.
    removed: BTreeSet<u32>,
}

impl Model {
    fn apply(&mut self, edit: &ListedEdit) {
        for index in &edit.removed {
            self.bodies.remove(index);
            self.removed.insert(*index);
        }
        for (index, b) in edit.set.iter().zip(&edit.boxes) {
            let new = Body { b: *b, on: true, is_static: false };
            self.bodies.entry(*index).or_insert(new).b = *b;
        }
        for (indices, on) in [(&edit.off, false), (&edit.on, true)] {
            self.each(indices, |body| body.on = on);
        }
        for (indices, is_static) in [(&edit.fixed, true), (&edit.loose, false)] {
            self.each(indices, |body| body.is_static = is_static);
        }
        self.pairs = self.all_pairs();
    }

    fn each(&mut self, indices: &[u32], change: impl Fn(&mut Body)) {
        for index in indices {
            if let Some(body) = self.bodies.get_mut(index) {
                change(body);
            }
        }
    }

    fn all_pairs(&self) -> BTreeSet<Pair> {
        let len = self.bodies.keys().last().map_or(0, |last| *last as usize + 1);
        let mut boxes = vec![Aabb::EMPTY; len];
        for (index, body) in self.bodies.iter().filter(|(_, body)| body.on) {
            boxes[*index as usize] = body.b;
        }
        let is_static = |index| self.bodies.get(&index).is_some_and(|body| body.is_static);
        let pairs = truth(&boxes).pairs.into_iter();
        pairs.filter(|(a, b)| !(is_static(*a) && is_static(*b))).collect()
    }

    /// Why a pair that was told is no more.
    fn reason(&self, (a, b): Pair) -> EndReason {
        let body = |index: u32| self.bodies.get(&index).filter(|_| !self.removed.contains(&index));
        match (body(a), body(b)) {
            (Some(a), Some(b)) if a.on && b.on && !(a.is_static && b.is_static) => {
                EndReason::Separated
            }
            (Some(_), Some(_)) => EndReason::Filtered,
            _ => EndReason::Removed,
        }
    }

    /// Compares an answer to an edit that named these boxes.
    fn check(&self, answer: &Answer, named: &BTreeSet<u32>) -> Result<(), Finding> {
        let all = || self.pairs.iter().copied();
        let is_renewed =
            |pair: &Pair| self.removed.contains(&pair.0) || self.removed.contains(&pair.1);
        let (mut begun, mut ended, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
        match answer.want {
            Want::Nothing => {}
            Want::Moved => {
                pairs = all().filter(|(a, b)| named.contains(a) || named.contains(b)).collect();
            }
            Want::Changes if !answer.is_resync => {
                let is_new = |pair: &Pair| !self.told.contains(pair) || is_renewed(pair);
                begun = all().filter(is_new).collect();
                let is_over = |pair: &&Pair| !self.pairs.contains(pair) || is_renewed(pair);
                ended = self.told.iter().filter(is_over).copied().collect();
            }
            _ => pairs = all().collect(),
        }
        same("begun", &answer.begun, &begun)?;
        let told: Vec<[u32; 2]> = answer.ended.iter().map(|ended| ended.pair).collect();
        same("ended", &told, &ended)?;
        same("pairs", &answer.pairs, &pairs)?;
        for Ended { pair: [a, b], reason } in &answer.ended {
            let expected = self.reason((*a, *b));
            if *reason != expected {
                let what = format!("pair ({a}, {b}) ended as {reason:?}, and is {expected:?}");
                return Err(Finding { what, missed: 0, extra: 0, first: Some((*a, *b)) });
            }
        }
        match answer.pair_count {
            Some(count) if count != self.pairs.len() as u64 => {
                let pairs = self.pairs.len();
                Err(Finding::other(&format!("the answer counts {count} pairs of {pairs}")))
            }
            _ => Ok(()),
        }
    }

    /// The client takes an answer of this kind.
    fn take(&mut self, want: Want) {
        if matches!(want, Want::Changes | Want::All) {
            self.told.clone_from(&self.pairs);
            self.removed.clear();
        }
    }
}

/// Compares a list of an answer, which is sorted and has nothing twice.
fn same(list: &str, got: &[[u32; 2]], expected: &[Pair]) -> Result<(), Finding> {
    let got: Vec<Pair> = got.iter().map(|[a, b]| (*a, *b)).collect();
    if let Some(two) = got.windows(2).find(|two| two[0] >= two[1]) {
        let what = format!("{list}: pair {:?} comes after {:?}", two[1], two[0]);
        return Err(Finding { what, missed: 0, extra: 1, first: Some(two[1]) });
    }
    compare(&got, expected, expected)
        .map_err(|found| Finding { what: format!("{list}: {}", found.what), ..found })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use pairmask::Backend;

    use super::*;

    fn session() -> Session {
        Session::builder().backend(Backend::InProcess).connect().unwrap()
    }

    #[test]
    fn scenes_of_a_session_are_right_edit_by_edit() {
        let mut random = Random::new(3);
        let (mut right, mut unread) = (0, 0);
        for _ in 0..6 {
            let mut kept = KeptScene::new(&mut session(), &mut random);
            for _ in 0..6 {
                let case = Case::new(Case::next_seed(&mut random));
                for _ in 0..10 {
                    match kept.edit(&case, &mut random).unwrap() {
                        Edited::Right(by) => {
                            assert_eq!(by, ServedBy::InProcess);
                            right += 1;
                        }
                        Edited::Unread => unread += 1,
                    }
                }
            }
        }
        assert!(right > 200 && unread > 20, "{right} right, {unread} unread");
    }

    /// A model of three boxes in a row whose pairs were told, and which then changed, with the answer.
    fn changed() -> (Model, Answer) {
        let at = |x: f32| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]);
        let mut model = Model::default();
        let boxes = [at(0.0), at(0.9), at(1.8), at(9.0)];
        let set = ListedEdit { set: vec![0, 1, 2, 3], boxes: boxes.to_vec(), ..Default::default() };
        model.apply(&set);
        model.take(Want::Changes);
        model.apply(&ListedEdit {
            // 0 is another box at the same place; 2 goes to 3.
            removed: vec![0],
            set: vec![0, 2],
            boxes: vec![at(0.0), at(9.5)],
            ..Default::default()
        });
        let ended = |pair, reason| Ended { pair, reason };
        let answer = Answer {
            want: Want::Changes,
            is_resync: false,
            begun: vec![[0, 1], [2, 3]],
            ended: vec![ended([0, 1], EndReason::Removed), ended([1, 2], EndReason::Separated)],
            pairs: Vec::new(),
            pair_count: Some(2),
            served_by: ServedBy::Daemon,
        };
        (model, answer)
    }

    #[test]
    fn whatever_is_wrong_in_an_answer_is_noticed() {
        let (model, right) = changed();
        let check = |answer: &Answer| model.check(answer, &BTreeSet::from([0, 2]));
        assert_eq!(check(&right), Ok(()));
        let spoils: [fn(&mut Answer); 9] = [
            |answer| answer.begun.truncate(1),
            |answer| answer.begun.push([2, 3]),
            |answer| answer.begun.swap(0, 1),
            |answer| answer.ended.truncate(1),
            |answer| answer.ended[0].reason = EndReason::Separated,
            |answer| answer.ended[1].reason = EndReason::Filtered,
            |answer| answer.pairs.push([0, 1]),
            |answer| answer.pair_count = Some(3),
            |answer| answer.is_resync = true,
        ];
        for (number, spoil) in spoils.into_iter().enumerate() {
            let mut answer = right.clone();
            spoil(&mut answer);
            assert!(check(&answer).is_err(), "{number}");
        }
        let pairs = vec![[0, 1], [2, 3]];
        let none = Answer { begun: Vec::new(), ended: Vec::new(), ..right };
        for want in [Want::All, Want::Moved] {
            assert_eq!(check(&Answer { want, pairs: pairs.clone(), ..none.clone() }), Ok(()));
            assert!(check(&Answer { want, ..none.clone() }).is_err());
        }
        let few = model.check(
            &Answer { want: Want::Moved, pairs: vec![[2, 3]], ..none },
            &BTreeSet::from([3]),
        );
        assert_eq!(few, Ok(()), "around the boxes that were named alone");
    }

    #[test]
    fn what_was_not_taken_is_told_again() {
        let (mut model, answer) = changed();
        // All of it is to be told with what comes after.
        model.apply(&ListedEdit { off: vec![3], ..Default::default() });
        let begun = vec![[0, 1]];
        let answer = Answer { begun, pair_count: Some(1), ..answer };
        assert_eq!(model.check(&answer, &BTreeSet::from([3])), Ok(()));
        model.take(Want::Moved);
        assert_eq!(model.check(&answer, &BTreeSet::new()), Ok(()), "tells of no end");
        model.take(Want::All);
        assert!(model.check(&answer, &BTreeSet::new()).is_err());
    }
}
