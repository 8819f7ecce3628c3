//! What has not been reported to a member yet: changes of several ticks as one.
//!
//! A pair is named by its indices and their incarnations, so that another box at an index makes another pair.
//! Changes are the difference of two sets of such pairs: that of the last acknowledged answer, and that of now.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use crate::scene::answer::{EndReason, Ended, Report, Reported, is_resync_due};
use crate::scene::edit::{Edit, Step};
use crate::scene::pair_list::Pair;

/// A pair by its indices, and by how many boxes each of them had lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NamedPair {
    /// The indices, smaller one first.
    pub pair: [u32; 2],
    incarnations: [u32; 2],
}

/// How many boxes each index has lost.
#[derive(Debug, Default)]
pub struct Incarnations {
    lost: HashMap<u32, u32>,
    /// Indices that lost one by the last edit.
    removed: HashSet<u32>,
}

impl Incarnations {
    /// Notes an edit that is right.
    pub fn apply(&mut self, edit: Edit<'_>) {
        self.removed.clear();
        for step in edit.steps {
            if let Step::Remove(indices) = step {
                indices.for_each(|_, index| {
                    self.removed.insert(index);
                    let lost = self.lost.entry(index).or_default();
                    *lost = lost.wrapping_add(1);
                });
            }
        }
    }

    /// How many boxes an index has lost.
    pub fn of(&self, index: u32) -> u32 {
        self.lost.get(&index).copied().unwrap_or(0)
    }

    fn now(&self, pair: Pair) -> NamedPair {
        NamedPair { pair, incarnations: pair.map(|index| self.of(index)) }
    }

    /// The name of a pair as it was before the last edit.
    fn before(&self, pair: Pair) -> NamedPair {
        let NamedPair { incarnations: [a, b], .. } = self.now(pair);
        let [first, second] = pair.map(|index| u32::from(self.removed.contains(&index)));
        NamedPair { pair, incarnations: [a.wrapping_sub(first), b.wrapping_sub(second)] }
    }

    /// Whether both boxes of a pair are still there.
    pub fn is_current(&self, named: NamedPair) -> bool {
        self.now(named.pair) == named
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.lost.capacity() * (size_of::<[u32; 2]>() + 1)
            + self.removed.capacity() * (size_of::<u32>() + 1)
    }
}

/// What one edit of the scene has changed.
#[derive(Debug)]
pub struct TickChanges {
    begun: Vec<NamedPair>,
    ended: Vec<NamedPair>,
    /// Pairs of the scene, after it.
    pair_count: u64,
}

impl TickChanges {
    /// Bytes that a member takes which notes all of them.
    pub const fn bytes(&self) -> u64 {
        ((self.begun.len() + self.ended.len()) * size_of::<NamedPair>()) as u64
    }

    /// By the answer to an edit that was [noted](Incarnations::apply), to which all before were acknowledged.
    pub fn of(reported: &Reported, incarnations: &Incarnations) -> Self {
        let begun = reported.begun().iter().map(|pair| incarnations.now(*pair));
        let ended = reported.ended().iter().map(|ended| incarnations.before(ended.pair));
        Self {
            begun: begun.collect(),
            ended: ended.collect(),
            pair_count: reported.pair_count().unwrap_or(0),
        }
    }
}

/// Changes since some moment: two sorted sets of pairs.
#[derive(Clone, Debug, Default)]
struct Changes {
    begun: Vec<NamedPair>,
    ended: Vec<NamedPair>,
}

impl Changes {
    fn then(self, later: Self) -> Self {
        if self.begun.is_empty() && self.ended.is_empty() {
            return later;
        }
        let mut joined = Self::default();
        let lists = [&self.begun, &self.ended, &later.begun, &later.ended];
        let mut at = [0; 4];
        let heads = |at: &[usize; 4]| -> [Option<NamedPair>; 4] {
            std::array::from_fn(|list| lists[list].get(at[list]).copied())
        };
        loop {
            let heads = heads(&at);
            let Some(pair) = heads.iter().flatten().min().copied() else { return joined };
            let [begun, ended, begun_later, ended_later] = heads.map(|head| head == Some(pair));
            for (at, is_here) in at.iter_mut().zip([begun, ended, begun_later, ended_later]) {
                *at += usize::from(is_here);
            }
            let was = ended || ended_later && !begun;
            let is = begun_later || begun && !ended_later;
            match (was, is) {
                (true, false) => joined.ended.push(pair),
                (false, true) => joined.begun.push(pair),
                _ => {}
            }
        }
    }

    fn len(&self) -> u64 {
        (self.begun.len() + self.ended.len()) as u64
    }

    fn allocated_bytes(&self) -> usize {
        (self.begun.capacity() + self.ended.capacity()) * size_of::<NamedPair>()
    }
}

/// The last answer, until it is known whether it was acknowledged.
#[derive(Debug)]
struct Answered {
    reported: Changes,
    is_whole: bool,
}

/// What has not been reported to one member yet.
///
/// Changes are counted from the last answer that was acknowledged, as those of a [`Scene`](super::super::Scene)
/// are. A member begins without knowing any pair, and gets all of them first.
#[derive(Debug, Default)]
pub struct Unreported {
    since: Changes,
    answered: Option<Answered>,
    /// Whether it is known which pairs the member knows.
    is_known: bool,
    /// The tick of the last answer, and of the last one that the member received; 0 before.
    answered_at: u64,
    received_at: u64,
}

impl Unreported {
    /// It is not known what the member knows: it gets a resync.
    pub fn resync(&mut self) {
        let Self { answered_at, received_at, .. } = *self;
        *self = Self { answered_at, received_at, ..Self::default() };
    }

    /// The tick of the last answer that the member received, regardless of what it reported: moved pairs are those of boxes that
    /// later ticks have named. 0 before.
    pub const fn received_at(&self) -> u64 {
        self.received_at
    }

    /// The member says whether it received the last answer.
    pub fn acknowledge(&mut self, is_acknowledged: bool) {
        if is_acknowledged {
            self.received_at = self.answered_at;
        }
        let Some(answered) = self.answered.take() else { return };
        if !is_acknowledged {
            let since = std::mem::take(&mut self.since);
            self.since = answered.reported.then(since);
        } else if answered.is_whole {
            self.is_known = true;
        }
    }

    /// The scene has changed. The member is to know of pairs that are `received`.
    pub fn note(&mut self, changes: &TickChanges, received: impl Fn(Pair) -> bool) {
        if !self.is_known && self.answered.is_none() {
            return;
        }
        let received =
            |list: &[NamedPair]| list.iter().copied().filter(|n| received(n.pair)).collect();
        let later = Changes { begun: received(&changes.begun), ended: received(&changes.ended) };
        let joined = std::mem::take(&mut self.since).then(later);
        if is_resync_due(joined.len(), changes.pair_count) {
            self.resync();
        } else {
            self.since = joined;
        }
    }

    /// Whether an answer needs all pairs.
    pub fn needs_whole(&self, report: Report) -> bool {
        report == Report::All || report == Report::Changes && !self.is_known
    }

    /// The answer to the member, at a tick. `pairs` are those of now that it is to know: all where they are
    /// [needed](Self::needs_whole), and moved ones. `reason` says why a pair ended, by the boxes of now.
    pub fn answer(
        &mut self,
        report: Report,
        tick: u64,
        pairs: Arc<Vec<Pair>>,
        pair_count: u64,
        reason: impl Fn(NamedPair) -> EndReason,
    ) -> Reported {
        self.answered_at = tick;
        let is_whole = self.needs_whole(report);
        match report {
            Report::Changes | Report::All => {}
            Report::Moved => return Reported::of_pairs(report, pairs, pair_count),
            _ => return Reported::of_none(Report::Nothing, pair_count),
        }
        let since = std::mem::take(&mut self.since);
        let reported = if is_whole {
            Reported::of_pairs(report, pairs, pair_count)
        } else {
            let ended = |named: &NamedPair| Ended { pair: named.pair, reason: reason(*named) };
            let begun = since.begun.iter().map(|named| named.pair).collect();
            let ended = since.ended.iter().map(ended).collect();
            Reported::of_changes(begun, ended, pair_count)
        };
        self.answered = Some(Answered { reported: since, is_whole });
        reported
    }

    /// Bytes that are kept.
    pub fn allocated_bytes(&self) -> usize {
        let answered = self.answered.as_ref();
        self.since.allocated_bytes()
            + answered.map_or(0, |answered| answered.reported.allocated_bytes())
    }
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init)] // A list of ranges is meant.
mod tests {
    use super::super::Ranges;
    use super::*;
    use crate::aabb::Aabb;
    use crate::scene::{Scene, SceneOptions, Sets};
    use proptest::prelude::*;

    const INDICES: u32 = 24;

    /// One edit: what happens to each index.
    fn apply(
        scene: &mut Scene,
        does: &[(u8, u8)],
        report: Report,
        incarnations: Option<&mut Incarnations>,
    ) {
        let has = |index: &u32| scene.get(*index).is_some();
        let who = |requested: &dyn Fn(u8) -> bool| -> Vec<u32> {
            (0..INDICES).filter(|index| requested(does[*index as usize].0 % 12)).collect()
        };
        let removed: Vec<u32> = who(&|what| what < 2).into_iter().filter(has).collect();
        let set = who(&|what| (1..6).contains(&what));
        let stays = |index: &u32| has(index) && !removed.contains(index) || set.contains(index);
        let off: Vec<u32> = who(&|what| what == 6).into_iter().filter(stays).collect();
        let on: Vec<u32> = who(&|what| what == 7).into_iter().filter(stays).collect();
        let boxes: Vec<Aabb> = set
            .iter()
            .map(|index| {
                let x = f32::from(does[*index as usize].1 % 30);
                Aabb::new([x, 0.0, 0.0], [x + 3.0, 1.0, 1.0])
            })
            .collect();
        let steps = [
            Step::Remove((&removed).into()),
            Step::Set(Sets { indices: (&set).into(), boxes: &boxes }),
            Step::Enable((&off).into(), false),
            Step::Enable((&on).into(), true),
        ];
        let edit = Edit { steps: &steps };
        scene.edit(edit, report).expect("a right edit");
        if let Some(incarnations) = incarnations {
            incarnations.apply(edit);
        }
    }

    proptest! {
        /// Several ticks, put together, are what a scene reports whose answers were not taken.
        #[test]
        fn ticks_put_together_are_what_a_scene_reports(
            ticks in prop::collection::vec(
                (prop::collection::vec(any::<(u8, u8)>(), INDICES as usize), 0u8..8), 1..30),
            own in 0u32..INDICES,
        ) {
            let options = SceneOptions::default().with_threads(1);
            let (mut asked, mut ticking) = (Scene::new(options), Scene::new(options));
            let own: Ranges = [own..INDICES].into_iter().collect();
            let received = |[a, b]: Pair| own.has(a) || own.has(b);
            let mut incarnations = Incarnations::default();
            let (mut all, mut some) = (Unreported::default(), Unreported::default());
            asked.resync();
            for (does, choice) in ticks {
                let report = if choice == 0 { Report::All } else { Report::Changes };
                apply(&mut asked, &does, report, None);
                apply(&mut ticking, &does, Report::Changes, Some(&mut incarnations));
                let pair_count = ticking.reported().pair_count;
                let changes = TickChanges::of(ticking.reported(), &incarnations);
                all.note(&changes, |_| true);
                some.note(&changes, received);
                ticking.acknowledge();
                ticking.edit(Edit::NONE, Report::All).expect("all pairs");
                let pairs = ticking.reported().pairs().to_vec();
                ticking.acknowledge();
                if choice == 1 {
                    // Nobody asks in this tick.
                    continue;
                }
                let reason = |named: NamedPair| {
                    if incarnations.is_current(named) {
                        ticking.store.states.end_reason(named.pair)
                    } else {
                        EndReason::Removed
                    }
                };
                let expected = asked.reported();
                let is_acknowledged = choice > 3;
                for (unreported, requested) in [(&mut all, None), (&mut some, Some(&own))] {
                    let received = |[a, b]: &Pair| requested.is_none_or(|own| own.has(*a) || own.has(*b));
                    let of_now: Vec<Pair> = pairs.iter().copied().filter(received).collect();
                    let of_now = Arc::new(of_now);
                    let answer = unreported.answer(report, 1, of_now, pair_count, reason);
                    prop_assert_eq!(answer.is_resync(), expected.is_resync());
                    prop_assert_eq!(answer.pair_count(), expected.pair_count());
                    let of = |pairs: &[Pair]| -> Vec<Pair> {
                        pairs.iter().copied().filter(received).collect()
                    };
                    prop_assert_eq!(answer.begun(), of(expected.begun()));
                    prop_assert_eq!(answer.pairs(), of(expected.pairs()));
                    let ended: Vec<Ended> =
                        expected.ended().iter().copied().filter(|e| received(&e.pair)).collect();
                    prop_assert_eq!(answer.ended(), ended);
                    unreported.acknowledge(is_acknowledged);
                }
                if is_acknowledged {
                    asked.acknowledge();
                }
            }
        }
    }

    fn knows_all() -> Unreported {
        let mut unreported = Unreported::default();
        unreported.answer(Report::All, 1, Arc::default(), 0, |_| EndReason::Separated);
        unreported.acknowledge(true);
        assert!(!unreported.needs_whole(Report::Changes));
        unreported
    }

    fn tick(begun: &[Pair], ended: &[Pair], of: &Incarnations) -> TickChanges {
        let ended = ended.iter().map(|pair| Ended { pair: *pair, reason: EndReason::Separated });
        TickChanges::of(&Reported::of_changes(begun.to_vec(), ended.collect(), 1), of)
    }

    #[test]
    fn a_long_history_is_a_resync() {
        let mut unreported = knows_all();
        let of = Incarnations::default();
        for other in 1..=4_096 {
            unreported.note(&tick(&[[0, other]], &[], &of), |_| true);
            assert!(!unreported.needs_whole(Report::Changes), "{other}");
        }
        unreported.note(&tick(&[[1, 2]], &[], &of), |_| true);
        assert!(
            unreported.needs_whole(Report::Changes),
            "no more changes are kept than are worth it"
        );
        assert_eq!(unreported.allocated_bytes(), 0);
    }

    #[test]
    fn a_removal_is_not_dropped_while_an_answer_is_not_acknowledged() {
        let mut of = Incarnations::default();
        let mut unreported = knows_all();
        unreported.note(&tick(&[[0, 1]], &[], &of), |_| true);
        unreported.answer(Report::Changes, 2, Arc::default(), 1, |_| EndReason::Separated);
        unreported.acknowledge(true);
        unreported.note(&tick(&[], &[[0, 1]], &of), |_| true);
        unreported.answer(Report::Changes, 3, Arc::default(), 0, |_| EndReason::Separated);
        unreported.acknowledge(false);
        // Index 0 gets another box, apart; then nothing happens; then it meets the old partner.
        of.apply(Edit { steps: &[Step::Remove((&[0]).into())] });
        unreported.note(&tick(&[], &[], &of), |_| true);
        of.apply(Edit::NONE);
        unreported.note(&tick(&[], &[], &of), |_| true);
        unreported.note(&tick(&[[0, 1]], &[], &of), |_| true);
        let removed = |named| {
            if of.is_current(named) { EndReason::Separated } else { EndReason::Removed }
        };
        let reported = unreported.answer(Report::Changes, 4, Arc::default(), 1, removed);
        assert_eq!(reported.begun(), [[0, 1]]);
        assert_eq!(reported.ended(), [Ended { pair: [0, 1], reason: EndReason::Removed }]);
    }
}
