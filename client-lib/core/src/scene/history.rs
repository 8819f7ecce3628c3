//! What began and ended around few changed boxes.
//!
//! A pair that changed has a box that changed. So each of those is looked around, as the hull of what it
//! was when the history began and what it is now, and each box found is tested both ways. Nothing is kept
//! of what was told: however many answers were dropped, no change is told twice or never.
//!
//! A pair of two changed boxes is found from both, and told from the one with the smaller index.

use super::cells::{CHANGED, Candidate, Cells, INDEX, Probe, STATIC, SearchMemory, is_solid};
use super::change::{WasIs, are_pair};
use super::fetch::ask_for;
use super::pair_list::{Difference, Pair, pair};
use super::store::{Solid, Store};
use crate::aabb::Aabb;
use crate::engine::strips::{in_parts, part_count};
use crate::floats;

/// Boxes of a task: a search takes about 0.2 µs.
const TASK_BOXES: usize = 256;
/// Boxes that are looked around at a time.
const BATCH: usize = 16;
/// Fewest boxes that are searched by place, and the least share of all, one in so many: below, two that
/// follow one another share no memory.
const SORTED_BOXES: usize = 512;
const SORTED_SHARE: usize = 128;

/// Searches for changes, and their memory.
#[derive(Debug, Default)]
pub(super) struct Changes {
    /// The changed boxes, in the order of the search.
    order: Vec<u32>,
    tasks: Vec<Search>,
}

/// A range of changed boxes, and what was found around them.
#[derive(Debug, Default)]
struct Search {
    boxes: std::ops::Range<usize>,
    tested: u64,
    found: Difference,
    around: Around,
}

/// Memory of one batch.
#[derive(Debug, Default)]
struct Around {
    /// The changed box of each probe.
    centres: Vec<Centre>,
    probes: Vec<Probe>,
    candidates: Vec<Candidate>,
    memory: SearchMemory,
}

/// A box that is looked around.
#[derive(Clone, Copy, Debug)]
struct Centre {
    index: u32,
    b: WasIs,
}

impl Changes {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let of_task = |task: &Search| {
            (task.found.begun.capacity() + task.found.ended.capacity()) * size_of::<Pair>()
        };
        4 * self.order.capacity() + self.tasks.iter().map(of_task).sum::<usize>()
    }

    /// What differs from then to now, in no order, some of it twice; and how many boxes were tested.
    pub fn find(&mut self, cells: &Cells, store: &Store, threads: usize) -> (Difference, u64) {
        let count = store.changed().len();
        let is_sorted = count >= SORTED_BOXES && count * SORTED_SHARE > store.boxes().len();
        let mut order = std::mem::take(&mut self.order);
        order.clear();
        if is_sorted {
            order.extend_from_slice(store.changed());
            by_place(&mut order, cells);
        }
        let boxes = if is_sorted { order.as_slice() } else { store.changed() };
        let parts = part_count(count, TASK_BOXES, threads);
        self.tasks.resize_with(parts, Search::default);
        let border = |part: usize| count * part / parts;
        for (part, task) in self.tasks.iter_mut().enumerate() {
            task.boxes = border(part)..border(part + 1);
        }
        let run = |tasks: &mut [Search]| {
            for task in tasks {
                task.run(&boxes[task.boxes.clone()], cells, store);
            }
        };
        in_parts(self.tasks.as_mut_slice(), parts, &run, &|(), ()| ());
        let mut all = Difference::default();
        let mut tested = 0;
        for task in &mut self.tasks {
            all.begun.append(&mut task.found.begun);
            all.ended.append(&mut task.found.ended);
            tested += task.tested;
        }
        self.order = order;
        (all, tested)
    }
}

/// Whether two solid boxes overlap, about: whether they are better looked around at once.
#[inline]
fn are_near(a: &Aabb, b: &Aabb) -> bool {
    (0..3)
        .fold(true, |near, axis| near & (a.min[axis] <= b.max[axis]) & (b.min[axis] <= a.max[axis]))
}

impl Centre {
    /// A box as it was and is.
    fn of(index: u32, store: &Store) -> Self {
        Self { index, b: WasIs::of(index, store) }
    }

    /// A box as it is, as though it had just come: all its pairs are of interest.
    fn now(index: u32, store: &Store) -> Self {
        let is = store.now(index);
        let was = Solid { b: Aabb::EMPTY, ..is };
        Self { index, b: WasIs { was, ..WasIs::unchanged(is) } }
    }

    /// Looks around it: once, where it has not gone far.
    fn probes(&self, mut add: impl FnMut(Probe)) {
        let (was, is) = (self.b.was.b, self.b.is.b);
        match (is_solid(&was), is_solid(&is)) {
            (false, false) => {}
            (true, true) if are_near(&was, &is) => {
                add(Probe { was, is, dismisses: self.b.is_same() });
            }
            (was_solid, is_solid) => {
                for (b, solid) in [(was, was_solid), (is, is_solid)] {
                    if solid {
                        add(Probe { was: b, is: b, dismisses: false });
                    }
                }
            }
        }
    }

    /// Whether its pair with the box of a slot began, and whether it ended.
    #[inline]
    fn change(&self, word: u32, store: &Store) -> [bool; 2] {
        let other = word & INDEX;
        if word & CHANGED == 0 {
            let b = store.boxes()[other as usize];
            let same = Solid { b, is_static: word & STATIC != 0 };
            return self.b.change(&WasIs::unchanged(same));
        }
        self.b.change(&WasIs::of(other, store))
    }
}

impl Search {
    fn run(&mut self, boxes: &[u32], cells: &Cells, store: &Store) {
        let Self { tested, found, around, .. } = self;
        *tested = 0;
        found.begun.clear();
        found.ended.clear();
        for (at, some) in boxes.chunks(BATCH).enumerate() {
            let next = (at + 1) * BATCH;
            for index in boxes.iter().skip(next).take(BATCH) {
                store.ask_for(*index);
            }
            let changed = some.iter().map(|index| Centre::of(*index, store));
            *tested += around.look(changed, cells, store);
            for (centre, &Candidate { word, .. }) in around.found() {
                let other = word & INDEX;
                let is_others = other < centre.index && word & CHANGED != 0;
                if other == centre.index || is_others && store.has_changed(other) {
                    continue;
                }
                let [begins, ends] = centre.change(word, store);
                if begins {
                    found.begun.push(pair(centre.index, other));
                }
                if ends {
                    found.ended.push(pair(centre.index, other));
                }
            }
        }
    }
}

impl Around {
    /// Finds the candidates of some boxes. Returns how many were tested.
    fn look(&mut self, around: impl Iterator<Item = Centre>, cells: &Cells, store: &Store) -> u64 {
        let Self { centres, probes, candidates, memory } = self;
        centres.clear();
        probes.clear();
        candidates.clear();
        for centre in around {
            centre.probes(|probe| {
                centres.push(centre);
                probes.push(probe);
            });
        }
        let tested = cells.look_around(probes, memory, candidates);
        // A slot may be that of an index that is no more: its box was removed at the end.
        candidates.retain(|candidate| ((candidate.word & INDEX) as usize) < store.boxes().len());
        for candidate in &*candidates {
            ask_for(store.boxes(), candidate.word & INDEX);
        }
        tested
    }

    /// Each candidate and the box that it was found around.
    fn found(&self) -> impl Iterator<Item = (&Centre, &Candidate)> {
        self.candidates.iter().map(|this| (&self.centres[this.probe as usize], this))
    }
}

/// Adds the pairs of now of some boxes, in no order, some of them twice. Of two boxes that the last edit
/// named, the one with the smaller index tells. Returns how many boxes were tested.
pub(super) fn pairs_of_named(cells: &Cells, store: &Store, pairs: &mut Vec<Pair>) -> u64 {
    let mut around = Around::default();
    let mut tested = 0;
    floats::with_default(|| {
        for some in store.named().chunks(BATCH) {
            let now = some.iter().map(|index| Centre::now(*index, store));
            tested += around.look(now, cells, store);
            for (centre, &Candidate { word, .. }) in around.found() {
                let (index, other) = (centre.index, word & INDEX);
                let is_told = other == index || store.is_named(other) && other < index;
                if !is_told && are_pair(&centre.b.is, &store.now(other)) {
                    pairs.push(pair(index, other));
                }
            }
        }
    });
    tested
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
