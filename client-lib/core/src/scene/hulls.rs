//! Changes where many boxes have changed: one cull of all, in which only changes are found.
//!
//! Each box is culled as the hull of what it was and what it is, so that every pair that was or is
//! is a candidate. The engine's tasks let those go whose boxes were and are over each other for sure:
//! where their cores overlap, what each of them was and is at once. Few are left where motion is small, and
//! those are tested both ways. A box that has left the place where it was would have a large hull; it is
//! culled as two boxes, one that was and one that is. A pair that such a box had and has comes as an end
//! and as a begin, which cancel out. Where many have left, hulls do not pay: all pairs of then and of
//! now are found ([`Whole`](super::whole::Whole)).

use super::change::change;
use super::entry::{Entry, Question};
use super::fetch::ask_for;
use super::pair_list::{Difference, Pair, pair};
use super::store::Store;
use crate::aabb::Aabb;
use crate::engine::strips::{appended, in_parts, part_count, zip_in_parts};
use crate::engine::{PairTest, Prepared};

const TASK_BOXES: usize = 8_192;
/// Boxes up to which cores are computed where they are needed.
const FEW_BOXES: usize = 4_096;
/// Pairs of a task that are tested both ways, at least.
const TASK_PAIRS: usize = 2_048;
/// Boxes that have left their places from which the lists of all pairs are compared: so many, and so large
/// a share, one in so many. Most of their pairs have changed, and each is found, sorted and kept.
const LEFT_LEAST: usize = 256;
const LEFT_SHARE: usize = 8;
/// Boxes, or pairs, from one whose state is read to one whose memory is asked for meanwhile.
const AHEAD: usize = 16;

/// A box as it was and as it is, on a cache line of its own.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct State {
    was: Entry,
    is: Entry,
}

impl State {
    const NONE: Self = Self { was: Entry::FREE, is: Entry::FREE };

    /// What the box was and is at once: free where that is nothing, or where pairs of the box may have
    /// changed although it has not moved.
    #[inline]
    fn core(&self) -> Entry {
        if self.is_touched() || self.was.is_static() != self.is.is_static() {
            return Entry::FREE;
        }
        // Two static boxes are no pair, whatever they do: no more than others a pair that changes.
        self.was.common(&self.is).of_no_flag()
    }

    /// Whether the box is another one than it was, or its filter data are.
    #[inline]
    const fn is_touched(&self) -> bool {
        self.was.index() & TOUCHED != 0
    }

    /// Whether it overlapped another box, and overlaps it, unless both were or are still.
    #[inline]
    fn overlaps(&self, other: &Self) -> [bool; 2] {
        let overlap = |a: &Entry, b: &Entry| Question::of(a).admits(b);
        [overlap(&self.was, &other.was), overlap(&self.is, &other.is)]
    }
}

/// Flag of an index: pairs of the box may have changed although it has not moved.
const TOUCHED: u32 = 1 << 31;

/// The changes of a scene as boxes to cull and a test of their pairs.
pub(super) struct Hulls<'a> {
    store: &'a Store,
    /// What is culled: a box for each index, then one for each that has left its place.
    boxes: Vec<Aabb>,
    /// The same as they were and are.
    states: Vec<State>,
    /// Indices that have left their place.
    left: Vec<u32>,
    /// Cores by the engine's position.
    cores: Prepared<Vec<Entry>>,
}

/// Memory that is kept from answer to answer.
#[derive(Default)]
pub(super) struct HullMemory {
    boxes: Vec<Aabb>,
    states: Vec<State>,
    cores: Vec<Entry>,
}

impl HullMemory {
    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>()
            + self.states.capacity() * size_of::<State>()
            + self.cores.capacity() * size_of::<Entry>()
    }
}

/// Some boxes of all, and their places in the two arrays.
struct Part<'a> {
    first: u32,
    boxes: &'a mut [Aabb],
    states: &'a mut [State],
}

impl<'a> Hulls<'a> {
    /// The changes of a scene since the history began.
    pub fn of(store: &'a Store, memory: &mut HullMemory, threads: usize) -> Self {
        let n = store.boxes().len();
        let HullMemory { mut boxes, mut states, cores } = std::mem::take(memory);
        boxes.resize(n, Aabb::EMPTY);
        states.resize(n, State::NONE);
        let parts = part_count(n, TASK_BOXES, threads);
        let step = n.div_ceil(parts).max(1);
        let arrays = boxes.chunks_mut(step).zip(states.chunks_mut(step));
        let mut work: Vec<Part<'_>> = arrays
            .enumerate()
            .map(|(i, (boxes, states))| Part { first: (i * step) as u32, boxes, states })
            .collect();
        let run = |work: &mut [Part<'_>]| {
            let mut left = Vec::new();
            for part in work {
                part.run(store, &mut left);
            }
            left
        };
        let left = in_parts(work.as_mut_slice(), parts, &run, &appended);
        boxes.extend(left.iter().map(|left| left.was));
        states.extend(left.iter().map(|left| left.state));
        let left = left.iter().map(|left| left.index).collect();
        Self { store, boxes, states, left, cores: Prepared::new(cores) }
    }

    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    #[inline]
    fn index(&self, culled: u32) -> u32 {
        match (culled as usize).checked_sub(self.store.boxes().len()) {
            Some(at) => self.left[at],
            None => culled,
        }
    }

    /// What began and ended of the pairs of culled boxes that the engine kept, in no order.
    pub fn changes(&self, kept: &[Pair], threads: usize) -> Difference {
        let parts = part_count(kept.len(), TASK_PAIRS, threads);
        let step = kept.len().div_ceil(parts).max(1);
        let mut work: Vec<&[Pair]> = kept.chunks(step).collect();
        let run = |work: &mut [&[Pair]]| {
            let mut found = Difference::default();
            for kept in work {
                self.add_changes(kept, &mut found);
            }
            found
        };
        in_parts(work.as_mut_slice(), parts, &run, &Difference::with)
    }

    fn add_changes(&self, kept: &[Pair], found: &mut Difference) {
        for (at, culled) in kept.iter().enumerate() {
            if let Some(ahead) = kept.get(at + AHEAD) {
                for culled in ahead {
                    ask_for(&self.states, *culled);
                }
            }
            let [one, other] = culled.map(|culled| &self.states[culled as usize]);
            let overlaps = one.overlaps(other);
            // Most have not changed; no more is looked up of those.
            if overlaps[0] != overlaps[1] || overlaps[0] && (one.is_touched() | other.is_touched())
            {
                let [a, b] = culled.map(|culled| self.index(culled));
                let pair = pair(a, b);
                let [begins, ends] = change(pair, overlaps, self.store);
                if begins {
                    found.begun.push(pair);
                }
                if ends {
                    found.ended.push(pair);
                }
            }
        }
    }

    /// Whether so many boxes have left their places that two culls find the changes sooner.
    pub fn are_many(&self) -> bool {
        self.left.len() > LEFT_LEAST.max(self.store.boxes().len() / LEFT_SHARE)
    }

    /// Whether a pair may come both as an end and as a begin without having changed.
    pub fn may_cancel(&self) -> bool {
        !self.left.is_empty()
    }

    /// Gives the memory back for the next answer.
    pub fn into_memory(self) -> HullMemory {
        let n = self.store.boxes().len();
        let (mut boxes, mut states) = (self.boxes, self.states);
        boxes.truncate(n);
        states.truncate(n);
        HullMemory { boxes, states, cores: self.cores.into_memory() }
    }
}

/// A box that has left its place, as it was.
struct Left {
    index: u32,
    was: Aabb,
    state: State,
}

impl Part<'_> {
    fn run(&mut self, store: &Store, left: &mut Vec<Left>) {
        let arrays = self.boxes.iter_mut().zip(self.states.iter_mut());
        for (index, (hull, state)) in (self.first..).zip(arrays) {
            let now = &store.boxes()[index as usize];
            let is = Entry::of(now, store.is_static(index), index);
            let Some(before) = store.before(index) else {
                (*hull, *state) = (*now, State { was: is, is });
                continue;
            };
            let is_touched = store.was_removed(index) || store.is_refiltered(index);
            let touched = if is_touched { TOUCHED } else { 0 };
            let was = Entry::of(&before.b, before.is_static, index | touched);
            *state = State { was, is };
            *hull = match (was.is_free(), is.is_free()) {
                (_, true) => before.b,
                (true, false) => *now,
                (false, false) if was.overlaps(&is) => was.hull(&is),
                (false, false) => {
                    let state_then = State { was, is: Entry::FREE };
                    left.push(Left { index, was: before.b, state: state_then });
                    state.was = Entry::FREE;
                    *now
                }
            };
        }
    }
}

impl PairTest for Hulls<'_> {
    /// Those that may have changed pass.
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let Some(cores) = self.cores.get() else {
            let culled = |at: u32| order.get(at as usize).map_or(at, |index| *index);
            return passing(row, block, bits, |at| self.states[culled(at) as usize].core());
        };
        passing(row, block, bits, |at| cores[at as usize])
    }

    #[inline]
    fn ask_for(&self, [row, block, bits]: [u32; 3]) {
        if let Some(cores) = self.cores.get() {
            ask_for(cores, row);
            // Two cores share a line, and those of a word are near each other.
            ask_for(cores, 32 * block + bits.trailing_zeros());
            ask_for(cores, 32 * block + 31 - bits.leading_zeros());
        }
    }

    fn prepare(&self, _: usize, order: &[u32], threads: usize) {
        if order.len() <= FEW_BOXES {
            return;
        }
        self.cores.prepare(|cores| {
            cores.resize(order.len(), Entry::FREE);
            zip_in_parts(cores, order, TASK_BOXES, threads, |cores, order| {
                for (at, (core, index)) in cores.iter_mut().zip(order).enumerate() {
                    if let Some(ahead) = order.get(at + AHEAD) {
                        ask_for(&self.states, *ahead);
                    }
                    *core = self.states[*index as usize].core();
                }
            });
            true
        });
    }
}

/// The bits of a word whose cores do not overlap.
#[inline(always)]
fn passing(row: u32, block: u32, bits: u32, core: impl Fn(u32) -> Entry) -> u32 {
    let question = Question::of(&core(row));
    let (mut passing, mut rest) = (bits, bits);
    while rest != 0 {
        let column = rest.trailing_zeros();
        passing ^= u32::from(question.admits(&core(32 * block + column))) << column;
        rest &= rest - 1;
    }
    passing
}
