//! What a member has not been told yet: changes of several ticks as one.

use std::collections::HashSet;
use std::sync::Arc;

use crate::scene::answer::{EndReason, Ended, Told, Want, is_resync_due};
use crate::scene::pair_list::Pair;

/// Ticks with removals that are put together. What comes after is told as a whole.
const MOST_REMOVALS: usize = 256;
/// Indices that those may name together: half a megabyte. Without a limit, a member that never commits would
/// keep all that are ever removed. One tick may name more, since who commits in every tick keeps no other.
const MOST_REMOVED: usize = 65_536;

/// What one edit of the scene has changed.
#[derive(Clone, Copy, Debug)]
pub struct TickChanges<'a> {
    /// Pairs that began, sorted.
    pub begun: &'a [[u32; 2]],
    /// Pairs that ended, sorted.
    pub ended: &'a [Ended],
    /// Indices whose boxes were removed.
    pub removed: &'a Arc<HashSet<u32>>,
    /// Pairs of the scene, after it.
    pub pair_count: u64,
}

/// Changes since some moment.
#[derive(Clone, Debug, Default)]
struct Changes {
    begun: Vec<Pair>,
    ended: Vec<Ended>,
    /// Indices whose boxes were removed meanwhile.
    removed: Vec<Arc<HashSet<u32>>>,
    /// Whether they are of several ticks: reasons are to be found again.
    is_joined: bool,
}

impl Changes {
    fn is_empty(&self) -> bool {
        self.begun.is_empty() && self.ended.is_empty()
    }

    fn is_removed(&self, [a, b]: Pair) -> bool {
        self.removed.iter().any(|removed| removed.contains(&a) || removed.contains(&b))
    }

    /// These, and then others.
    fn then(self, mut later: Self) -> Self {
        // What was removed matters to pairs that there were before, which ended with it.
        if self.is_empty() {
            return later;
        }
        let mut removed = self.removed.clone();
        removed.append(&mut later.removed);
        let mut joined = Self { removed, is_joined: true, ..Self::default() };
        let mut lists = Merge { first: &self, later: &later, at: [0; 4] };
        while let Some((pair, [begun, ended, begun_later, ended_later])) = lists.next() {
            // A pair that both ended and began is another one now, and there was one before.
            let was = ended || !begun && ended_later;
            let is = begun_later || !ended_later && begun;
            let is_same = was && is && !joined.is_removed(pair);
            if was && !is_same {
                joined.ended.push(Ended { pair, reason: EndReason::Separated });
            }
            if is && !is_same {
                joined.begun.push(pair);
            }
        }
        joined
    }
}

/// A pass over four sorted lists at once.
struct Merge<'a> {
    first: &'a Changes,
    later: &'a Changes,
    at: [usize; 4],
}

impl Merge<'_> {
    /// The next pair, and in which of the lists it is: begun, ended, begun later, ended later.
    fn next(&mut self) -> Option<(Pair, [bool; 4])> {
        let [b, e, c, d] = self.at;
        let heads = [
            self.first.begun.get(b).copied(),
            self.first.ended.get(e).map(|ended| ended.pair),
            self.later.begun.get(c).copied(),
            self.later.ended.get(d).map(|ended| ended.pair),
        ];
        let pair = heads.iter().flatten().min().copied()?;
        let is_here = heads.map(|head| head == Some(pair));
        self.at.iter_mut().zip(is_here).for_each(|(at, is_here)| *at += usize::from(is_here));
        Some((pair, is_here))
    }
}

/// The last answer, until it is known whether it was taken.
#[derive(Debug)]
struct Answered {
    told: Changes,
    is_whole: bool,
}

/// What one member has not taken yet.
///
/// Changes are counted from the last answer that was taken, as those of a [`Scene`](super::super::Scene)
/// are. A member begins without knowing any pair, and is told all of them first.
#[derive(Debug)]
pub struct Untold {
    since: Changes,
    answered: Option<Answered>,
    /// Whether it is not known what the member knows.
    is_lost: bool,
}

impl Default for Untold {
    fn default() -> Self {
        Self { since: Changes::default(), answered: None, is_lost: true }
    }
}

impl Untold {
    /// The member knows nothing of what it was told.
    pub fn lose(&mut self) {
        *self = Self::default();
    }

    /// The member says whether it took the last answer.
    pub fn acknowledge(&mut self, is_taken: bool) {
        let Some(answered) = self.answered.take() else { return };
        if !is_taken {
            let since = std::mem::take(&mut self.since);
            self.since = answered.told.then(since);
        } else if answered.is_whole {
            self.is_lost = false;
        }
    }

    /// The scene has changed. The member is told of pairs that are `heard`.
    pub fn note(&mut self, changes: TickChanges<'_>, heard: impl Fn(Pair) -> bool) {
        if self.is_lost && self.answered.is_none() {
            return;
        }
        let heard = |pair: &Pair| heard(*pair);
        let later = Changes {
            begun: changes.begun.iter().copied().filter(heard).collect(),
            ended: changes.ended.iter().copied().filter(|ended| heard(&ended.pair)).collect(),
            removed: if changes.removed.is_empty() {
                vec![]
            } else {
                vec![changes.removed.clone()]
            },
            is_joined: false,
        };
        let joined = std::mem::take(&mut self.since).then(later);
        let many = (joined.begun.len() + joined.ended.len()) as u64;
        let is_long = joined.removed.len() > MOST_REMOVALS || self.keeps_many_with(&joined);
        if is_resync_due(many, changes.pair_count) || is_long {
            self.lose();
        } else {
            self.since = joined;
        }
    }

    /// Whether removals of several ticks name too many indices, with those of these changes.
    fn keeps_many_with(&self, since: &Changes) -> bool {
        let answered = self.answered.iter().flat_map(|answered| &answered.told.removed);
        let (mut ticks, mut indices) = (0, 0);
        for removed in answered.chain(&since.removed) {
            ticks += 1;
            indices += removed.len();
        }
        ticks > 1 && indices > MOST_REMOVED
    }

    /// Whether an answer needs all pairs.
    pub fn needs_whole(&self, want: Want) -> bool {
        want == Want::All || want == Want::Changes && self.is_lost
    }

    /// What the member is told. `whole` are the pairs that it hears of, where that is
    /// [needed](Self::needs_whole); `reason` says why a pair of boxes that are still there is none now.
    /// The lists go back by [`Self::note_told`].
    pub fn answer(
        &mut self,
        want: Want,
        whole: Option<Arc<Vec<Pair>>>,
        pair_count: u64,
        reason: impl Fn(Pair) -> EndReason,
    ) -> Told {
        let is_whole = self.needs_whole(want);
        if !matches!(want, Want::Changes | Want::All) {
            return Told::of_none(Want::Nothing, pair_count);
        }
        let mut told = std::mem::take(&mut self.since);
        if is_whole {
            self.answered = Some(Answered { told, is_whole: true });
            return Told::of_pairs(want, whole.unwrap_or_default(), pair_count);
        }
        if told.is_joined {
            let removed = |pair| told.is_removed(pair);
            let reasons = told.ended.iter().map(|Ended { pair, .. }| {
                if removed(*pair) { EndReason::Removed } else { reason(*pair) }
            });
            let reasons: Vec<EndReason> = reasons.collect();
            told.ended.iter_mut().zip(reasons).for_each(|(ended, reason)| ended.reason = reason);
        }
        let (begun, ended) = (std::mem::take(&mut told.begun), std::mem::take(&mut told.ended));
        self.answered = Some(Answered { told, is_whole: false });
        Told::of_changes(begun, ended, pair_count)
    }

    /// What [`answer`](Self::answer) gave is written: its lists count as told if the member takes them.
    pub fn note_told(&mut self, told: Told) {
        if let Some(Answered { told: kept, is_whole: false }) = &mut self.answered {
            (kept.begun, kept.ended) = told.into_changes();
        }
    }

    /// Bytes that are kept. Members share what a tick has removed: each counts its part of that.
    pub fn allocated_bytes(&self) -> usize {
        let share = |removed: &Arc<HashSet<u32>>| {
            let bytes = removed.capacity() * (size_of::<u32>() + 1);
            size_of::<Arc<HashSet<u32>>>() + bytes / Arc::strong_count(removed)
        };
        let bytes = |changes: &Changes| {
            changes.begun.capacity() * size_of::<Pair>()
                + changes.ended.capacity() * size_of::<Ended>()
                + changes.removed.iter().map(share).sum::<usize>()
        };
        bytes(&self.since) + self.answered.as_ref().map_or(0, |answered| bytes(&answered.told))
    }
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init)] // A list of ranges is meant.
mod tests {
    use super::super::Ranges;
    use super::*;
    use crate::aabb::Aabb;
    use crate::scene::{Edit, Scene, SceneOptions, Sets, Step};
    use proptest::prelude::*;

    const INDICES: u32 = 24;

    /// One edit: what happens to each index.
    fn apply(scene: &mut Scene, does: &[(u8, u8)], want: Want) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
        let has = |index: &u32| scene.get(*index).is_some();
        let who = |wanted: &dyn Fn(u8) -> bool| -> Vec<u32> {
            (0..INDICES).filter(|index| wanted(does[*index as usize].0 % 12)).collect()
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
            Step::Switch((&off).into(), false),
            Step::Switch((&on).into(), true),
        ];
        scene.edit(Edit { steps: &steps }, want).expect("a right edit");
        (removed, off, on)
    }

    proptest! {
        /// Several ticks, put together, are what a scene tells whose answers were not taken.
        #[test]
        fn ticks_put_together_are_what_a_scene_tells(
            ticks in prop::collection::vec(
                (prop::collection::vec(any::<(u8, u8)>(), INDICES as usize), 0u8..8), 1..30),
            own in 0u32..INDICES,
        ) {
            let options = SceneOptions::default().with_threads(1);
            let (mut asked, mut ticking) = (Scene::new(options), Scene::new(options));
            let own: Ranges = [own..INDICES].into_iter().collect();
            let heard = |[a, b]: Pair| own.has(a) || own.has(b);
            let mut off = HashSet::new();
            let (mut all, mut some) = (Untold::default(), Untold::default());
            asked.lose();
            for (does, choice) in ticks {
                let want = if choice == 0 { Want::All } else { Want::Changes };
                apply(&mut asked, &does, want);
                let (removed, switched_off, switched_on) = apply(&mut ticking, &does, Want::Changes);
                removed.iter().chain(&switched_on).for_each(|index| { off.remove(index); });
                off.extend(switched_off);
                let told = ticking.told();
                let removed = Arc::new(removed.into_iter().collect());
                let changes = TickChanges {
                    begun: told.begun(),
                    ended: told.ended(),
                    removed: &removed,
                    pair_count: told.pair_count,
                };
                all.note(changes, |_| true);
                some.note(changes, heard);
                let pair_count = told.pair_count;
                ticking.take();
                ticking.edit(Edit::NONE, Want::All).expect("all pairs");
                let pairs = ticking.told().pairs().to_vec();
                ticking.take();
                if choice == 1 {
                    // Nobody asks in this tick.
                    continue;
                }
                let reason = |[a, b]: Pair| {
                    let is_off = off.contains(&a) || off.contains(&b);
                    if is_off { EndReason::Filtered } else { EndReason::Separated }
                };
                let expected = asked.told();
                let is_taken = choice > 3;
                for (untold, wanted) in [(&mut all, None), (&mut some, Some(&own))] {
                    let heard = |[a, b]: &Pair| wanted.is_none_or(|own| own.has(*a) || own.has(*b));
                    let of_now: Vec<Pair> = pairs.iter().copied().filter(heard).collect();
                    let answer = untold.answer(want, Some(Arc::new(of_now)), pair_count, reason);
                    prop_assert_eq!(answer.is_resync(), expected.is_resync());
                    prop_assert_eq!(answer.pair_count(), expected.pair_count());
                    let of = |pairs: &[Pair]| -> Vec<Pair> {
                        pairs.iter().copied().filter(heard).collect()
                    };
                    prop_assert_eq!(answer.begun(), of(expected.begun()));
                    prop_assert_eq!(answer.pairs(), of(expected.pairs()));
                    let ended: Vec<Ended> =
                        expected.ended().iter().copied().filter(|e| heard(&e.pair)).collect();
                    prop_assert_eq!(answer.ended(), ended);
                    untold.note_told(answer);
                    untold.acknowledge(is_taken);
                }
                if is_taken {
                    asked.take();
                }
            }
        }
    }

    #[test]
    fn a_long_history_is_told_as_a_whole() {
        let mut untold = Untold::default();
        untold.answer(Want::All, None, 0, |_| EndReason::Separated);
        untold.acknowledge(true);
        assert!(!untold.needs_whole(Want::Changes));
        let removed = Arc::new(HashSet::from([1]));
        for tick in 0..=MOST_REMOVALS as u32 {
            assert!(!untold.needs_whole(Want::Changes));
            let (begun, removed) = ([[2, tick + 3]], &removed);
            untold
                .note(TickChanges { begun: &begun, ended: &[], removed, pair_count: 1 }, |_| true);
        }
        assert!(untold.needs_whole(Want::Changes), "removals are not kept without end");
        assert_eq!(untold.allocated_bytes(), 0);
    }

    #[test]
    fn many_removed_indices_are_kept_of_one_tick_alone() {
        let knowing = || {
            let mut untold = Untold::default();
            untold.answer(Want::All, None, 0, |_| EndReason::Separated);
            untold.acknowledge(true);
            untold
        };
        let (mut commits, mut is_late, mut leaves) = (knowing(), knowing(), knowing());
        let note = |untold: &mut Untold, removed: &Arc<HashSet<u32>>| {
            let begun = [[u32::MAX - 1, u32::MAX]];
            untold
                .note(TickChanges { begun: &begun, ended: &[], removed, pair_count: 1 }, |_| true);
        };
        for tick in 0..3 {
            let removed = Arc::new((0..=MOST_REMOVED as u32).collect::<HashSet<u32>>());
            note(&mut commits, &removed);
            assert!(
                !commits.needs_whole(Want::Changes),
                "who commits in every tick is told changes"
            );
            assert!(commits.allocated_bytes() > 4 * MOST_REMOVED / Arc::strong_count(&removed));
            commits.answer(Want::Changes, None, 1, |_| EndReason::Separated);
            commits.acknowledge(true);
            note(&mut is_late, &removed);
            assert_eq!(is_late.needs_whole(Want::Changes), tick > 0);
            note(&mut leaves, &removed);
            if tick == 0 {
                // What was answered, and nobody takes, counts as well.
                leaves.answer(Want::Changes, None, 1, |_| EndReason::Separated);
            }
            assert_eq!(leaves.needs_whole(Want::Changes), tick > 0);
        }
        assert_eq!((is_late.allocated_bytes(), leaves.allocated_bytes()), (0, 0));
    }
}
