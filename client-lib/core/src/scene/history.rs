//! What has changed since the last answer that was taken, and what was told then.
//!
//! Nothing is kept of a pair of two boxes that have not changed since. For each box that has, the boxes
//! that it was a pair with at that time are kept: they are looked up in the cells when the box first
//! changes, before it moves there. So a change is what differs between these and the pairs of now, and
//! however many answers were dropped, none is told twice or never.
//!
//! A pair of two changed boxes belongs to the one that changed first. When it changed, the other had
//! not, so what the cells said of the pair was what had been told.

use super::cells::{Cells, SearchMemory};
use super::pair_list::{Difference, pair};
use super::store::Store;
use crate::engine::strips::{in_parts, part_count};

/// Boxes of a task: a search takes about 0.2 µs.
const TASK_BOXES: usize = 256;
/// Fewest boxes that are searched by place, and the least share of all, one in so many: below, two that
/// follow one another share no memory.
const SORTED_BOXES: usize = 512;
const SORTED_SHARE: usize = 128;
/// Not changed.
const UNCHANGED: u32 = u32::MAX;

/// The boxes that have changed, in the order in which they first did, and the pairs that they had.
#[derive(Debug, Default)]
pub(super) struct Changed {
    boxes: Vec<u32>,
    /// End of each box's partners.
    ends: Vec<usize>,
    /// Boxes that a changed box was a pair with, sorted for each.
    partners: Vec<u32>,
    /// Which of all boxes have changed.
    bits: Vec<u64>,
    /// For those, the place in `boxes`.
    rank: Vec<u32>,
    tasks: Vec<Search>,
}

/// A range of changed boxes, and what was found around them.
#[derive(Debug, Default)]
struct Search {
    boxes: std::ops::Range<usize>,
    tested: u64,
    lens: Vec<u32>,
    partners: Vec<u32>,
    found: Difference,
    memory: SearchMemory,
}

impl Changed {
    /// How many boxes have changed.
    pub fn len(&self) -> usize {
        self.boxes.len()
    }

    /// The boxes that have changed.
    pub fn boxes(&self) -> &[u32] {
        &self.boxes
    }

    /// Those that were noted last, `count` of them.
    pub fn last(&self, count: usize) -> &[u32] {
        &self.boxes[self.boxes.len() - count..]
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let words = self.boxes.capacity() + self.partners.capacity() + self.rank.capacity();
        let of_tasks = |task: &Search| 4 * (task.lens.capacity() + task.partners.capacity());
        4 * words
            + 8 * (self.bits.capacity() + self.ends.capacity())
            + self.tasks.iter().map(of_tasks).sum::<usize>()
    }

    /// Nothing has changed.
    pub fn clear(&mut self) {
        for index in self.boxes.drain(..) {
            self.bits[index as usize / 64] &= !(1 << (index % 64));
        }
        self.ends.clear();
        self.partners.clear();
    }

    /// Whether a box has changed.
    #[inline]
    pub fn has(&self, index: u32) -> bool {
        self.bits.get(index as usize / 64).is_some_and(|word| word >> (index % 64) & 1 == 1)
    }

    /// Lists boxes that are not listed yet: by place, where they are so many that neighbours follow one
    /// another then.
    fn list(&mut self, fresh: &[u32], cells: &Cells, box_count: usize) {
        if self.bits.len() * 64 < box_count {
            self.bits.resize(box_count.div_ceil(64), 0);
        }
        if self.rank.len() < box_count {
            self.rank.resize(box_count, UNCHANGED);
        }
        let first = self.boxes.len();
        self.boxes.extend_from_slice(fresh);
        if fresh.len() >= SORTED_BOXES && fresh.len() * SORTED_SHARE > box_count {
            by_place(&mut self.boxes[first..], cells);
        }
        for (rank, index) in (first as u32..).zip(&self.boxes[first..]) {
            self.bits[*index as usize / 64] |= 1 << (index % 64);
            self.rank[*index as usize] = rank;
        }
    }

    /// Notes boxes that are about to change for the first time, and the pairs that they have in `cells`.
    /// `box_count` is more than any index. Returns how many entries were tested.
    pub fn note(&mut self, fresh: &[u32], cells: &Cells, box_count: usize, threads: usize) -> u64 {
        let first = self.boxes.len();
        self.list(fresh, cells, box_count);
        let mut tasks = self.share_out(first..self.boxes.len(), threads);
        let this = &*self;
        let run =
            |tasks: &mut [Search]| tasks.iter_mut().for_each(|task| task.partners(this, cells));
        let parts = tasks.len();
        in_parts(tasks.as_mut_slice(), parts, &run, &|(), ()| ());
        for task in &tasks {
            for len in &task.lens {
                self.ends.push(self.ends.last().copied().unwrap_or(0) + *len as usize);
            }
            self.partners.extend_from_slice(&task.partners);
        }
        let tested = tasks.iter().map(|task| task.tested).sum();
        self.tasks = tasks;
        tested
    }

    /// What differs from then to now, in the order of the boxes, and how many entries were tested.
    pub fn difference(
        &mut self,
        cells: &Cells,
        store: &Store,
        threads: usize,
    ) -> (Difference, u64) {
        let mut tasks = self.share_out(0..self.boxes.len(), threads);
        let this = &*self;
        let run = |tasks: &mut [Search]| {
            for task in tasks {
                task.differences(this, cells, store);
            }
        };
        let parts = tasks.len();
        in_parts(tasks.as_mut_slice(), parts, &run, &|(), ()| ());
        let mut all = Difference::default();
        let mut tested = 0;
        for task in &mut tasks {
            all.begun.append(&mut task.found.begun);
            all.ended.append(&mut task.found.ended);
            tested += task.tested;
        }
        self.tasks = tasks;
        (all, tested)
    }

    fn share_out(&mut self, boxes: std::ops::Range<usize>, threads: usize) -> Vec<Search> {
        let mut tasks = std::mem::take(&mut self.tasks);
        let parts = part_count(boxes.len(), TASK_BOXES, threads);
        tasks.resize_with(parts, Search::default);
        for (part, task) in tasks.iter_mut().enumerate() {
            let border = |part: usize| boxes.start + boxes.len() * part / parts;
            task.boxes = border(part)..border(part + 1);
            task.tested = 0;
        }
        tasks
    }

    /// Whether the pair of a box with this rank and another belongs to the other.
    #[inline(always)]
    fn is_others(&self, rank: u32, other: u32) -> bool {
        self.has(other) && self.rank[other as usize] < rank
    }

    /// The partners that a box of a rank had.
    fn partners_of(&self, rank: usize) -> &[u32] {
        let start = if rank == 0 { 0 } else { self.ends[rank - 1] };
        &self.partners[start..self.ends[rank]]
    }
}

impl Search {
    /// Finds the partners of boxes before they move.
    fn partners(&mut self, changed: &Changed, cells: &Cells) {
        let ranks = self.boxes.clone();
        let first = ranks.start;
        self.partners.clear();
        self.lens.clear();
        self.lens.resize(ranks.len(), 0);
        let (partners, lens) = (&mut self.partners, &mut self.lens);
        self.tested = cells.around_each(&changed.boxes[ranks], &mut self.memory, |at, other| {
            if !changed.is_others((first + at) as u32, other) {
                partners.push(other);
                lens[at] += 1;
            }
        });
        let mut rest = self.partners.as_mut_slice();
        for len in &self.lens {
            let (here, later) = rest.split_at_mut(*len as usize);
            here.sort_unstable();
            rest = later;
        }
    }

    /// Finds the pairs that began and ended.
    fn differences(&mut self, changed: &Changed, cells: &Cells, store: &Store) {
        self.partners(changed, cells);
        self.found.begun.clear();
        self.found.ended.clear();
        let any_removed = store.any_removed();
        let mut rest = self.partners.as_slice();
        for (rank, len) in self.boxes.clone().zip(&self.lens) {
            let (now, later) = rest.split_at(*len as usize);
            rest = later;
            let then = changed.partners_of(rank);
            if then == now && !any_removed {
                continue;
            }
            let index = changed.boxes[rank];
            let replaced = |other: u32| store.was_removed(index) || store.was_removed(other);
            compare(index, then, now, replaced, &mut self.found);
        }
    }
}

/// Sorts boxes by their place: by counting, digit by digit.
fn by_place(boxes: &mut [u32], cells: &Cells) {
    const DIGIT: u32 = 11;
    let mut places: Vec<[u32; 2]> =
        boxes.iter().map(|index| [cells.place(*index), *index]).collect();
    let mut sorted = vec![[0; 2]; boxes.len()];
    let most = places.iter().map(|[place, _]| *place).max().unwrap_or(0);
    for shift in (0..u32::BITS - most.leading_zeros()).step_by(DIGIT as usize) {
        let digit = |place: u32| (place >> shift & ((1 << DIGIT) - 1)) as usize;
        let mut starts = [0u32; 1 << DIGIT];
        for [place, _] in &places {
            starts[digit(*place)] += 1;
        }
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        for this in &places {
            let start = &mut starts[digit(this[0])];
            sorted[*start as usize] = *this;
            *start += 1;
        }
        std::mem::swap(&mut places, &mut sorted);
    }
    for (slot, [_, index]) in boxes.iter_mut().zip(&places) {
        *slot = *index;
    }
}

/// What differs between two sorted lists of partners.
fn compare(
    index: u32,
    mut then: &[u32],
    mut now: &[u32],
    replaced: impl Fn(u32) -> bool,
    found: &mut Difference,
) {
    loop {
        let (was, is) = (then.first().copied(), now.first().copied());
        if let Some(was) = was.filter(|was| is.is_none_or(|is| *was <= is)) {
            if is != Some(was) || replaced(was) {
                found.ended.push(pair(index, was));
            }
            then = &then[1..];
        }
        if let Some(is) = is.filter(|is| was.is_none_or(|was| *is <= was)) {
            if was != Some(is) || replaced(is) {
                found.begun.push(pair(index, is));
            }
            now = &now[1..];
        }
        if was.is_none() && is.is_none() {
            return;
        }
    }
}
