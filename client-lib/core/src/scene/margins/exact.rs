//! The pairs of the boxes of now, kept by a client of a scene of inflated boxes.
//!
//! A pair that overlaps is near, and changes only where one of its boxes does. So the near pairs around
//! boxes that changed are tested, and nothing else is looked at. What was reported is a bit of each pair; what
//! may differ from it is in a list.

use std::sync::Arc;

use super::super::answer::{EndReason, Ended, Report, Reported, is_resync_due};
use super::super::change::begins_and_ends;
use super::super::copy::SceneCopy;
use super::super::edit::Edit;
use super::super::pair_list::{Pair, pair};
use super::super::states::{CHANGED, LOST, NAMED};
use super::super::store::are_same;
use super::rows::state::{IS, NEAR, WAS};
use super::rows::{Rows, is_pair};
use crate::aabb::KeyBox;
use crate::team::{self, appended, in_parts, part_count};

/// Changed boxes of a task, at least.
const TASK_BOXES: usize = 4_096;
/// A box whose near pairs are tested takes so long on one thread, ns.
const BOX_NS: f64 = 100.0;
/// Boxes from one whose pairs are tested to one whose neighbours are asked for meanwhile.
const AHEAD: usize = 8;
/// Pairs that may have changed, up to which the list of them is left as it is.
const FEW_PAIRS: usize = 4_096;
/// Named boxes of this share of all take as long as to go through all pairs: one in so many.
const MANY_SHARE: usize = 8;

/// The pairs of the boxes of now: what a [`Scene`](super::super::Scene) of these boxes would report, bit by
/// bit, but for the meter of work left out.
///
/// It learns of each edit before it is applied ([`note`](Self::note)), and of the changes of the near
/// pairs. [`report`](Self::report) needs to have all of them. An edit whose near pairs are not known yet may
/// wait: nothing is asked of it.
///
/// Memory: 25 bytes for each index, and 8 to 16 for each near pair.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::scene::{Edit, ExactPairs, Indices, SceneCopy, Sets, Step, Report};
///
/// let boxes = [[0.0, 1.0], [1.5, 2.0]].map(|[a, b]| Aabb::new([a; 3], [b; 3]));
/// let (mut now, mut pairs) = (SceneCopy::new(9), ExactPairs::default());
/// let mut edit = |steps: &[Step<'_>], near: &[[u32; 2]]| {
///     let edit = Edit { steps };
///     now.check(edit)?;
///     pairs.note(edit, &now, Report::Changes);
///     now.apply(edit);
///     pairs.change_near(near.iter().copied(), std::iter::empty(), &now);
///     Ok::<_, pairmask_core::scene::EditError>(pairs.report(Report::Changes, &now, None).begun().to_vec())
/// };
/// // Near, by what was sent of them, and apart.
/// assert!(edit(&[Step::Set(Sets { indices: (0..2).into(), boxes: &boxes })], &[[0, 1]])?.is_empty());
/// let nearer = [Aabb::new([0.5; 3], [1.5; 3])];
/// assert_eq!(edit(&[Step::Set(Sets { indices: (0..1).into(), boxes: &nearer })], &[])?, [[0, 1]]);
/// # Ok::<(), pairmask_core::scene::EditError>(())
/// ```
#[derive(Debug, Default)]
pub struct ExactPairs {
    rows: Rows,
    /// By index: whether it has [`CHANGED`] since its near pairs were tested, has [`LOST`] a box since the last
    /// acknowledged answer, and was [`NAMED`] by the last edit.
    flags: Vec<u8>,
    /// Indices whose box has changed since near pairs were tested.
    changed: Vec<u32>,
    /// Indices that lost a box since the last acknowledged answer.
    removed: Vec<u32>,
    /// Indices that the last edit set, enabled or disabled or flagged, where pairs of these are needed.
    named: Vec<u32>,
    /// Pairs that may differ from what was reported; some more than once.
    touched: Vec<Pair>,
    /// How many of them there were when they were last looked through.
    touched_kept: usize,
    /// Whether it is not known what was reported.
    is_lost: bool,
    pair_count: u64,
    reported: Reported,
    /// Whether the last answer can be taken.
    is_open: bool,
    /// Pairs that became near.
    fresh: Vec<Pair>,
    ends: Vec<Pair>,
}

impl ExactPairs {
    /// Notes an edit that is right, before it is applied to the boxes of now, which have
    /// [checked](SceneCopy::check) it. `report` is what will be asked of it.
    pub fn note(&mut self, edit: Edit<'_>, before: &SceneCopy, report: Report) {
        self.is_open = false;
        self.rows.grow(before.index_end());
        self.flags.resize(self.rows.len(), 0);
        edit.for_each_removed(|index| self.note_removed(index));
        edit.for_each_set(|index, b| {
            if !before.get(index).is_some_and(|was| are_same(&was, b)) {
                self.note_changed(index);
            }
        });
        for index in self.named.drain(..) {
            self.flags[index as usize] &= !NAMED;
        }
        if report == Report::Moved {
            let Self { named, flags, .. } = self;
            before.for_each_named(edit, |index| {
                // A list may name indices that have no box.
                if flags.get(index as usize).is_some_and(|flags| flags & NAMED == 0) {
                    flags[index as usize] |= NAMED;
                    named.push(index);
                }
            });
        }
    }

    #[inline]
    fn note_changed(&mut self, index: u32) {
        let flags = &mut self.flags[index as usize];
        if *flags & CHANGED == 0 {
            *flags |= CHANGED;
            self.changed.push(index);
        }
    }

    fn note_removed(&mut self, index: u32) {
        self.note_changed(index);
        if self.flags[index as usize] & LOST != 0 {
            return;
        }
        self.flags[index as usize] |= LOST;
        self.removed.push(index);
        if !self.is_lost {
            let reported = self.rows.of(index).filter(|(_, state)| state & WAS != 0);
            self.touched.extend(reported.map(|(other, _)| pair(index, other)));
        }
    }

    /// Takes changes of the near pairs: what ended, and what began. Pairs that the scene cannot have are passed
    /// over, and so are ends of pairs that were not near.
    pub fn change_near(
        &mut self,
        begun: impl IntoIterator<Item = [u32; 2]>,
        ended: impl IntoIterator<Item = [u32; 2]>,
        now: &SceneCopy,
    ) {
        for pair in ended {
            if self.is_valid(pair) {
                self.set_state(pair, |state| state & WAS);
            }
        }
        self.begin_near(begun, now);
    }

    /// Takes all near pairs in place of those that were known.
    pub fn resync_near(&mut self, pairs: impl IntoIterator<Item = [u32; 2]>, now: &SceneCopy) {
        self.rows.set_all(|state| state & WAS);
        self.pair_count = 0;
        self.begin_near(pairs, now);
        self.touched.clear();
        if !self.is_lost {
            let Self { touched, rows, flags, .. } = self;
            let differ =
                rows.iter().filter(|(pair, state)| change(*pair, *state, flags) != [false; 2]);
            touched.extend(differ.map(|(pair, _)| pair));
        }
    }

    /// Whether the scene may have such a pair. Lists of near pairs come from another process.
    const fn is_valid(&self, [a, b]: Pair) -> bool {
        a < b && (b as usize) < self.rows.len()
    }

    fn begin_near(&mut self, begun: impl IntoIterator<Item = [u32; 2]>, now: &SceneCopy) {
        let mut fresh = std::mem::take(&mut self.fresh);
        for pair in begun {
            if !self.is_valid(pair) {
                continue;
            }
            let near = || if overlap(pair, now) { NEAR | IS } else { NEAR };
            if !self.set_state(pair, |state| state & WAS | near()) {
                fresh.push(pair);
            }
        }
        if !fresh.is_sorted_by(|low, high| low < high) {
            fresh.sort_unstable();
            fresh.dedup();
        }
        for pair in fresh.drain(..) {
            let is = overlap(pair, now);
            self.rows.add(pair, if is { NEAR | IS } else { NEAR });
            if is {
                self.pair_count += 1;
                self.touch(pair);
            }
        }
        self.rows.tidy();
        self.fresh = fresh;
    }

    /// Sets the state of a pair to what `to` makes of it, if the rows have it; whether they do.
    #[inline]
    fn set_state(&mut self, pair: Pair, to: impl Fn(u32) -> u32) -> bool {
        let mut is = false;
        let before = self.rows.update(pair, |state| {
            let state = to(state);
            is = is_pair(state);
            state
        });
        let Some(before) = before else { return false };
        match (is_pair(before), is) {
            (false, true) => self.pair_count += 1,
            (true, false) => self.pair_count -= 1,
            _ => return true,
        }
        self.touch(pair);
        true
    }

    fn touch(&mut self, pair: Pair) {
        if !self.is_lost {
            self.touched.push(pair);
        }
    }

    /// Tests the near pairs around boxes that changed.
    fn settle(&mut self, now: &SceneCopy, threads: Option<usize>) {
        let mut changed = std::mem::take(&mut self.changed);
        let threads = team::threads_for(changed.len() as f64 * BOX_NS, threads);
        let _team = team::enter(threads);
        let parts = part_count(changed.len(), TASK_BOXES, threads);
        let run = |indices: &mut [u32]| self.flips(indices, now);
        let flips = in_parts(changed.as_mut_slice(), parts, &run, &appended);
        for pair in flips {
            self.set_state(pair, |state| state ^ IS);
        }
        for index in changed.drain(..) {
            self.flags[index as usize] &= !CHANGED;
        }
        self.changed = changed;
        if self.touched.len() > 2 * self.touched_kept + FEW_PAIRS {
            self.look_through_touched(|_, _| {});
        }
    }

    /// Near pairs around these boxes of which is no longer true what their state says; each pair once.
    fn flips(&self, indices: &[u32], now: &SceneCopy) -> Vec<Pair> {
        let mut flips = Vec::new();
        for (at, &index) in indices.iter().enumerate() {
            if let Some(&later) = indices.get(at + 2 * AHEAD) {
                self.rows.ask_for(later);
            }
            if let Some(&later) = indices.get(at + AHEAD) {
                self.rows.of(later).for_each(|(other, _)| now.ask_for(other));
            }
            let key = key_of(index, now);
            for (other, state) in self.rows.of(index) {
                let is_others = other < index && self.flags[other as usize] & CHANGED != 0;
                let is_near = state & NEAR != 0;
                if is_near && !is_others && key_of(other, now).overlaps(&key) != is_pair(state) {
                    flips.push(pair(index, other));
                }
            }
        }
        flips
    }

    /// Sorts the pairs that may have changed, lets those go that have not, and calls `f` with each of the
    /// others and whether it began and ended.
    fn look_through_touched(&mut self, mut f: impl FnMut(Pair, [bool; 2])) {
        let Self { touched, rows, flags, .. } = self;
        touched.sort_unstable();
        touched.dedup();
        touched.retain(|pair| {
            let change = change(*pair, rows.state(*pair), flags);
            if change != [false; 2] {
                f(*pair, change);
            }
            change != [false; 2]
        });
        self.touched_kept = self.touched.len();
    }

    /// Answers, as the last edit was [noted](Self::note) to need. Unless that is nothing, near pairs are
    /// those of now.
    pub fn report(&mut self, report: Report, now: &SceneCopy, threads: Option<usize>) -> &Reported {
        if report != Report::Nothing {
            self.settle(now, threads);
        }
        self.reported = match report {
            Report::Nothing => Reported::of_none(report, 0),
            Report::Moved => Reported::of_pairs(report, Arc::new(self.pairs_of_named()), 0),
            Report::Changes if !self.is_lost => self.changes(now),
            Report::Changes | Report::All => self.all(report),
        };
        self.is_open = true;
        &self.reported
    }

    fn all(&self, report: Report) -> Reported {
        let mut pairs = Vec::with_capacity(self.pair_count as usize);
        pairs.extend(self.rows.iter().filter(|(_, state)| is_pair(*state)).map(|(pair, _)| pair));
        Reported::of_pairs(report, Arc::new(pairs), self.pair_count)
    }

    fn changes(&mut self, now: &SceneCopy) -> Reported {
        let (mut begun, mut ended) = std::mem::take(&mut self.reported).into_changes();
        begun.clear();
        ended.clear();
        let mut ends = std::mem::take(&mut self.ends);
        self.look_through_touched(|pair, [is_begun, is_ended]| {
            if is_begun {
                begun.push(pair);
            }
            if is_ended {
                ends.push(pair);
            }
        });
        ended.extend(ends.drain(..).map(|pair| Ended { pair, reason: self.reason(pair, now) }));
        self.ends = ends;
        if is_resync_due((begun.len() + ended.len()) as u64, self.pair_count) {
            return self.all(Report::Changes);
        }
        Reported::of_changes(begun, ended, self.pair_count)
    }

    /// Why a pair ended, by the boxes of now.
    fn reason(&self, [a, b]: Pair, now: &SceneCopy) -> EndReason {
        if (self.flags[a as usize] | self.flags[b as usize]) & LOST != 0 {
            return EndReason::Removed;
        }
        now.states().end_reason([a, b])
    }

    /// Pairs with a box that the last edit named.
    fn pairs_of_named(&self) -> Vec<Pair> {
        let mut pairs = Vec::new();
        if self.named.len() > self.rows.len() / MANY_SHARE {
            let is_named = |index: u32| self.flags[index as usize] & NAMED != 0;
            let named = self
                .rows
                .iter()
                .filter(|([a, b], state)| is_pair(*state) && (is_named(*a) || is_named(*b)));
            pairs.extend(named.map(|(pair, _)| pair));
            return pairs;
        }
        for &index in &self.named {
            let with = self.rows.of(index).filter(|(_, state)| is_pair(*state));
            pairs.extend(with.map(|(other, _)| pair(index, other)));
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// The last answer.
    pub const fn reported(&self) -> &Reported {
        &self.reported
    }

    /// Acknowledges the last answer, as [`Scene::acknowledge`](super::super::Scene::acknowledge) does.
    pub fn acknowledge(&mut self) {
        let is_open = std::mem::take(&mut self.is_open);
        if !is_open || !matches!(self.reported.report(), Report::Changes | Report::All) {
            return;
        }
        let reported = |state: u32| if is_pair(state) { state | WAS } else { state & !WAS };
        if std::mem::take(&mut self.is_lost) {
            self.rows.set_all(reported);
        } else {
            for &pair in &self.touched {
                self.rows.update(pair, reported);
            }
            self.rows.tidy();
        }
        self.touched.clear();
        self.touched_kept = 0;
        for index in self.removed.drain(..) {
            self.flags[index as usize] &= !LOST;
        }
    }

    /// Drops what was reported: the next changes are a [resync](Reported::is_resync).
    pub fn resync(&mut self) {
        (self.is_lost, self.is_open) = (true, false);
        self.touched.clear();
        self.touched_kept = 0;
    }

    /// Bytes that are allocated, beside what the allocator adds.
    pub fn allocated_bytes(&self) -> usize {
        let indices = self.changed.capacity() + self.removed.capacity() + self.named.capacity();
        let pairs = self.touched.capacity() + self.fresh.capacity() + self.ends.capacity();
        self.rows.allocated_bytes()
            + self.flags.capacity()
            + indices * size_of::<u32>()
            + pairs * size_of::<Pair>()
            + self.reported.allocated_bytes()
    }
}

/// Whether a pair of this state began, and whether it ended. A pair of an index that has another box did both.
fn change([a, b]: Pair, state: u32, flags: &[u8]) -> [bool; 2] {
    let is_replaced = (flags[a as usize] | flags[b as usize]) & LOST != 0;
    begins_and_ends(state & WAS != 0, is_pair(state), is_replaced)
}

#[inline]
fn key_of(index: u32, now: &SceneCopy) -> KeyBox {
    now.get(index).map_or(KeyBox::NOTHING, |b| KeyBox::from(&b))
}

fn overlap([a, b]: Pair, now: &SceneCopy) -> bool {
    key_of(a, now).overlaps(&key_of(b, now))
}
