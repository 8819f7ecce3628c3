//! Changes where many boxes have changed: one cull of all, in which only changes are found.
//!
//! Each box is culled as the hull of what it was and what it is, so that every pair that was or is
//! is a candidate. The engine's tasks test each candidate both ways, and keep those that began or ended:
//! few, where motion is small. A box that has left the place where it was would have a large hull; it is
//! culled as two boxes, one that was and one that is. A pair that such a box had and has comes as an end
//! and as a begin, which cancel out.

use std::sync::{Mutex, OnceLock, PoisonError};

use super::cells::{Entry, Question};
use super::pair_list::{Difference, Pair, pair};
use super::store::{Before, Store};
use crate::aabb::{Aabb, KeyBox};
use crate::engine::PairTest;
use crate::engine::strips::{in_parts, part_count};

/// Boxes of a task, at least.
const TASK_BOXES: usize = 8_192;
/// Boxes up to which states are computed where they are needed.
const FEW_BOXES: usize = 4_096;

/// A box as it was and as it is.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct State {
    was: Entry,
    is: Entry,
}

/// The changes of a scene as boxes to cull and a test of their pairs.
pub(super) struct Hulls<'a> {
    store: &'a Store,
    /// Place of each index among the changed ones; only those of changed ones are right.
    rank: Vec<u32>,
    /// What is culled: a box for each index, then one for each that has left its place.
    boxes: Vec<Aabb>,
    /// Indices that have left their place.
    left: Vec<u32>,
    /// States by the engine's position, once it has said its order.
    states: OnceLock<Vec<State>>,
    memory: Mutex<Vec<State>>,
}

/// Memory that is kept from answer to answer.
#[derive(Default)]
pub(super) struct HullMemory {
    rank: Vec<u32>,
    boxes: Vec<Aabb>,
    states: Vec<State>,
}

impl HullMemory {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        4 * self.rank.capacity()
            + self.boxes.capacity() * size_of::<Aabb>()
            + self.states.capacity() * size_of::<State>()
    }
}

/// Where a box that has left its place is culled as it is, or as it was; or neither: as both.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Both,
    Was,
    Is,
}

impl<'a> Hulls<'a> {
    /// The changes of a scene since the history began.
    pub fn of(store: &'a Store, memory: &mut HullMemory, threads: usize) -> Self {
        let n = store.boxes().len();
        let HullMemory { mut rank, mut boxes, states } = std::mem::take(memory);
        rank.resize(n, 0);
        for (place, index) in (0u32..).zip(store.changed()) {
            rank[*index as usize] = place;
        }
        boxes.resize(n, Aabb::EMPTY);
        let mut hulls = Self {
            store,
            rank,
            boxes: Vec::new(),
            left: Vec::new(),
            states: OnceLock::new(),
            memory: Mutex::new(states),
        };
        let this = &hulls;
        let parts = part_count(n, TASK_BOXES, threads);
        let step = n.div_ceil(parts).max(1);
        let mut work: Vec<(u32, &mut [Aabb])> =
            boxes.chunks_mut(step).enumerate().map(|(i, part)| ((i * step) as u32, part)).collect();
        let run = |work: &mut [(u32, &mut [Aabb])]| {
            let mut left = Vec::new();
            for (first, boxes) in work {
                for (index, b) in (*first..).zip(boxes.iter_mut()) {
                    *b = this.hull(index).unwrap_or_else(|| {
                        left.push(index);
                        this.store.boxes()[index as usize]
                    });
                }
            }
            left
        };
        let left = in_parts(work.as_mut_slice(), parts, &run, &|mut low: Vec<u32>, high| {
            low.extend(high);
            low
        });
        boxes.extend(left.iter().map(|index| hulls.before(*index).b));
        (hulls.boxes, hulls.left) = (boxes, left);
        hulls
    }

    /// What is to be culled.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Gives the memory back for the next answer.
    pub fn into_memory(self) -> HullMemory {
        let mut boxes = self.boxes;
        boxes.truncate(self.store.boxes().len());
        let states = self.states.into_inner();
        let kept = self.memory.into_inner().unwrap_or_else(PoisonError::into_inner);
        HullMemory { rank: self.rank, boxes, states: states.unwrap_or(kept) }
    }

    /// What an index was when the history began.
    #[inline]
    fn before(&self, index: u32) -> Before {
        if self.store.has_changed(index) {
            self.store.before()[self.rank[index as usize] as usize]
        } else {
            Before { b: self.store.boxes()[index as usize], is_static: self.store.is_static(index) }
        }
    }

    /// The hull of what an index was and is; `None` where it has left its place.
    #[inline]
    fn hull(&self, index: u32) -> Option<Aabb> {
        let now = self.store.boxes()[index as usize];
        if !self.store.has_changed(index) {
            return Some(now);
        }
        let (is, was) = (KeyBox::from(&now), KeyBox::from(&self.before(index).b));
        if is == KeyBox::NOTHING || was == KeyBox::NOTHING {
            return Some(if is == KeyBox::NOTHING { self.before(index).b } else { now });
        }
        is.overlaps(&was).then(|| {
            let hull = KeyBox {
                min: std::array::from_fn(|axis| is.min[axis].min(was.min[axis])),
                max: std::array::from_fn(|axis| is.max[axis].max(was.max[axis])),
            };
            hull.to_box()
        })
    }

    /// The index of a culled box, and which part of it that is.
    #[inline]
    fn part(&self, culled: u32) -> (u32, Part) {
        let n = self.store.boxes().len() as u32;
        if culled >= n {
            return (self.left[(culled - n) as usize], Part::Was);
        }
        let has_left = !self.left.is_empty() && self.left.binary_search(&culled).is_ok();
        (culled, if has_left { Part::Is } else { Part::Both })
    }

    fn state(&self, culled: u32) -> State {
        let (index, part) = self.part(culled);
        let before = self.before(index);
        let entry = |b: &Aabb, is_static: bool, wanted: bool, lane: u32| {
            let key = KeyBox::from(b);
            if wanted && key != KeyBox::NOTHING {
                Entry::new(&key, is_static, lane)
            } else {
                Entry::FREE
            }
        };
        let now = &self.store.boxes()[index as usize];
        State {
            was: entry(&before.b, before.is_static, part != Part::Is, 0),
            is: entry(now, self.store.is_static(index), part != Part::Was, 0),
        }
    }

    /// Adds the pairs that the engine has kept, by index, to what began and ended.
    pub fn sort_out(&self, kept: &[Pair], found: &mut Difference) {
        for [a, b] in kept {
            let ([a_state, b_state], [a, b]) = (
                [a, b].map(|culled| self.state(*culled)),
                [a, b].map(|culled| self.part(*culled).0),
            );
            if admits(&a_state.was, &b_state.was) {
                found.ended.push(pair(a, b));
            }
            if admits(&a_state.is, &b_state.is) {
                found.begun.push(pair(a, b));
            }
        }
    }

    /// Whether a pair may come both as an end and as a begin without having changed.
    pub fn may_cancel(&self) -> bool {
        !self.left.is_empty()
    }
}

/// Whether two entries are a pair.
#[inline(always)]
fn admits(one: &Entry, other: &Entry) -> bool {
    Question::of(one).admits(other)
}

impl PairTest for Hulls<'_> {
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let states = self.states.get().map(Vec::as_slice);
        let index = |position: u32| order.get(position as usize).map_or(position, |index| *index);
        let state = |position: u32| match states {
            Some(states) => states[position as usize],
            None => self.state(index(position)),
        };
        let any_removed = self.store.any_removed();
        let one = state(row);
        let (was, is) = (Question::of(&one.was), Question::of(&one.is));
        let (mut passing, mut rest) = (0, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            let position = 32 * block + column;
            let other = state(position);
            let (had, has) = (was.admits(&other.was), is.admits(&other.is));
            let is_replaced =
                || [row, position].iter().any(|p| self.store.was_removed(self.part(index(*p)).0));
            let changed = (had != has) || (any_removed && had && is_replaced());
            passing |= u32::from(changed) << column;
            rest &= rest - 1;
        }
        passing
    }

    fn prepare(&self, order: &[u32], threads: usize) {
        if order.len() <= FEW_BOXES {
            return;
        }
        let mut states =
            std::mem::take(&mut *self.memory.lock().unwrap_or_else(PoisonError::into_inner));
        states.resize(order.len(), State { was: Entry::FREE, is: Entry::FREE });
        let parts = part_count(order.len(), TASK_BOXES, threads);
        let step = order.len().div_ceil(parts).max(1);
        let mut work: Vec<(&mut [State], &[u32])> =
            states.chunks_mut(step).zip(order.chunks(step)).collect();
        let run = |work: &mut [(&mut [State], &[u32])]| {
            for (states, order) in work {
                for (at, (state, index)) in states.iter_mut().zip(*order).enumerate() {
                    if let Some(ahead) = order.get(at + AHEAD) {
                        self.ask_for(*ahead);
                    }
                    *state = self.state(*index);
                }
            }
        };
        in_parts(work.as_mut_slice(), parts, &run, &|(), ()| ());
        // Only one engine runs at a time, and says its order once.
        let _ = self.states.set(states);
    }
}

/// Boxes from one whose state is computed to one whose memory is asked for meanwhile.
const AHEAD: usize = 12;

impl Hulls<'_> {
    #[inline]
    fn ask_for(&self, culled: u32) {
        if let Some(rank) = self.rank.get(culled as usize) {
            self.store.ask_for(culled, *rank);
        }
    }
}
