//! Changes where many boxes have changed: one cull of all, in which only changes are found.
//!
//! Each box is culled as the hull of what it was and what it is, so that every pair that was or is
//! is a candidate. The engine's tasks test each candidate both ways, and keep those that began or ended:
//! few, where motion is small. A box that has left the place where it was would have a large hull; it is
//! culled as two boxes, one that was and one that is. A pair that such a box had and has comes as an end
//! and as a begin, which cancel out. Where many have left, hulls do not pay: all pairs of then and of
//! now are found ([`Whole`](super::whole::Whole)).

use std::sync::{Mutex, OnceLock, PoisonError};

use super::entry::{Entry, Question};
use super::fetch::ask_for;
use super::pair_list::{Difference, Pair, pair};
use super::store::Store;
use crate::aabb::Aabb;
use crate::engine::PairTest;
use crate::engine::strips::{in_parts, part_count};

/// Boxes of a task, at least.
const TASK_BOXES: usize = 8_192;
/// Boxes up to which states are computed where they are needed.
const FEW_BOXES: usize = 4_096;

/// Boxes that have left their places from which the lists of all pairs are compared: so many, and so large
/// a share, one in so many. Most of their pairs have changed, and each is found, sorted and kept.
const LEFT_LEAST: usize = 256;
const LEFT_SHARE: usize = 8;
/// Boxes from one whose state is moved to one whose memory is asked for meanwhile.
const AHEAD: usize = 16;
/// Lists of ended pairs: threads that take different ones do not wait for each other.
const ENDED_LISTS: usize = 16;

/// A box as it was and as it is, on a cache line of its own.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct State {
    was: Entry,
    is: Entry,
}

impl State {
    const NONE: Self = Self { was: Entry::FREE, is: Entry::FREE };
}

/// The changes of a scene as boxes to cull and a test of their pairs.
pub(super) struct Hulls<'a> {
    store: &'a Store,
    /// What is culled: a box for each index, then one for each that has left its place.
    boxes: Vec<Aabb>,
    /// The same as they were and are.
    states: Vec<State>,
    /// Indices that have left their place.
    left: Vec<u32>,
    /// States by the engine's position, once it has said its order.
    ordered: OnceLock<Vec<State>>,
    /// Pairs that ended.
    ended: [Mutex<Vec<Pair>>; ENDED_LISTS],
    memory: Mutex<Vec<State>>,
}

/// Memory that is kept from answer to answer.
#[derive(Default)]
pub(super) struct HullMemory {
    boxes: Vec<Aabb>,
    states: Vec<State>,
    ordered: Vec<State>,
}

impl HullMemory {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>()
            + (self.states.capacity() + self.ordered.capacity()) * size_of::<State>()
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
        let HullMemory { mut boxes, mut states, ordered } = std::mem::take(memory);
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
        let left = in_parts(work.as_mut_slice(), parts, &run, &|mut low: Vec<Left>, high| {
            low.extend(high);
            low
        });
        boxes.extend(left.iter().map(|left| left.was));
        states.extend(left.iter().map(|left| left.state));
        let left = left.iter().map(|left| left.index).collect();
        let memory = Mutex::new(ordered);
        let ended = std::array::from_fn(|_| Mutex::default());
        Self { store, boxes, states, left, ordered: OnceLock::new(), ended, memory }
    }

    /// What is to be culled.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The index of a culled box.
    #[inline]
    fn index(&self, culled: u32) -> u32 {
        match (culled as usize).checked_sub(self.store.boxes().len()) {
            Some(at) => self.left[at],
            None => culled,
        }
    }

    /// What began and ended, in no order: `begun` are the pairs of culled boxes that the engine kept.
    pub fn named(&self, begun: &[Pair]) -> Difference {
        let mut ended = Vec::new();
        for list in &self.ended {
            ended.append(&mut lock(list));
        }
        if self.left.is_empty() {
            return Difference { begun: begun.to_vec(), ended };
        }
        let named = |[a, b]: &Pair| pair(self.index(*a), self.index(*b));
        for pair in &mut ended {
            *pair = named(pair);
        }
        Difference { begun: begun.iter().map(named).collect(), ended }
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
        let kept = self.memory.into_inner().unwrap_or_else(PoisonError::into_inner);
        let ordered = self.ordered.into_inner().unwrap_or(kept);
        HullMemory { boxes, states, ordered }
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
            let was = Entry::of(&before.b, before.is_static, index);
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

/// Locks a list; that of a panicking thread is as good as any.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PairTest for Hulls<'_> {
    /// Those that began pass. Those that ended are kept here.
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let culled = |position: u32| order.get(position as usize).map_or(position, |index| *index);
        let ordered = self.ordered.get().map(Vec::as_slice);
        let state = |position: u32| match ordered {
            Some(states) => &states[position as usize],
            None => &self.states[culled(position) as usize],
        };
        let any_removed = self.store.any_removed();
        let one = state(row);
        let (was, is) = (Question::of(&one.was), Question::of(&one.is));
        let (mut begun, mut ended, mut rest) = (0, 0, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            let other = state(32 * block + column);
            let (had, has) = (was.admits(&other.was), is.admits(&other.is));
            let is_replaced = || {
                [one, other].iter().any(|s| {
                    let entry = if s.is.is_free() { &s.was } else { &s.is };
                    self.store.was_removed(entry.index())
                })
            };
            let replaced = any_removed && had && has && is_replaced();
            begun |= u32::from(has && (!had || replaced)) << column;
            ended |= u32::from(had && (!has || replaced)) << column;
            rest &= rest - 1;
        }
        if ended != 0 {
            let list = rayon::current_thread_index().unwrap_or(0) % ENDED_LISTS;
            let mut list = lock(&self.ended[list]);
            while ended != 0 {
                let position = 32 * block + ended.trailing_zeros();
                list.push(pair(culled(row), culled(position)));
                ended &= ended - 1;
            }
        }
        begun
    }

    #[inline]
    fn ask_for(&self, row: u32, block: u32, bits: u32) {
        if let Some(states) = self.ordered.get() {
            ask_for(states, row);
            let mut rest = bits;
            while rest != 0 {
                ask_for(states, 32 * block + rest.trailing_zeros());
                rest &= rest - 1;
            }
        }
    }

    fn prepare(&self, order: &[u32], threads: usize) {
        if order.len() <= FEW_BOXES {
            return;
        }
        let mut states = std::mem::take(&mut *lock(&self.memory));
        states.resize(order.len(), State::NONE);
        let parts = part_count(order.len(), TASK_BOXES, threads);
        let step = order.len().div_ceil(parts).max(1);
        let mut work: Vec<(&mut [State], &[u32])> =
            states.chunks_mut(step).zip(order.chunks(step)).collect();
        let run = |work: &mut [(&mut [State], &[u32])]| {
            for (states, order) in work {
                for (at, (state, index)) in states.iter_mut().zip(*order).enumerate() {
                    if let Some(ahead) = order.get(at + AHEAD) {
                        ask_for(&self.states, *ahead);
                    }
                    *state = self.states[*index as usize];
                }
            }
        };
        in_parts(work.as_mut_slice(), parts, &run, &|(), ()| ());
        // One engine runs, and says its order once.
        let _ = self.ordered.set(states);
    }
}
