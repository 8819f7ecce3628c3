//! What began and ended around few changed boxes.
//!
//! A pair that changed has a box that changed. So each of those is looked around, as the hull of what it
//! was when the history began and what it is now, and each box found is tested both ways. Nothing is kept
//! of what was reported: however many answers were dropped, no change is reported twice or never.
//!
//! A pair of two changed boxes is found from both, and reported from the one with the smaller index.

pub(super) mod crowded;

use std::sync::atomic::{AtomicU64, Ordering};

use super::cells::{
    BATCH, BATCHES, CHANGED, Candidate, Cells, INDEX, Looked, Probe, STATIC, in_stages, is_valid,
};
use super::change::{WasIs, change};
use super::pair_list::{Difference, Pair, pair, starts_of};
use super::states;
use super::store::{BoxState, Store};
use crate::aabb::Aabb;
use crate::cancel::{Cancel, Pace};
use crate::fetch::ask_for;
use crate::team::{for_each_in_parts, part_count, zip_in_parts};
use crate::test_budget::{TestBudget, TestLot};

/// Boxes of a task: a search takes about 0.2 µs.
const TASK_BOXES: usize = 256;
/// Fewest boxes that are searched by place, and the least share of all, one in so many: below, two that
/// follow one another share no memory.
const SORTED_BOXES: usize = 512;
const SORTED_SHARE: usize = 128;

/// Tests of a search, and for each box of the scene, that searches take at the most: a third of what a cull of all boxes
/// takes. A search of boxes that cells part tests 30 to 100.
const TESTS_A_SEARCH: i64 = 512;
const TESTS_A_BOX: i64 = 8;

/// Changes that a task finds before it tells the others.
const COUNTED_TOGETHER: usize = 1_024;

/// How much a search may test and find, by all threads together, and whether anybody waits for it.
struct Bound<'a> {
    tests: TestBudget,
    found: AtomicU64,
    most: u64,
    cancel: &'a Cancel,
}

impl<'a> Bound<'a> {
    const fn new(tests: i64, most: u64, cancel: &'a Cancel) -> Self {
        Self { tests: TestBudget::new(tests), found: AtomicU64::new(0), most, cancel }
    }

    /// Counts what a task has found, many changes together, from those on that are counted.
    fn count(&self, found: &Difference, counted: &mut usize) {
        let all = found.begun.len() + found.ended.len();
        if all - *counted >= COUNTED_TOGETHER {
            // Relaxed: a number that ends a search, and that nothing is read by.
            self.found.fetch_add((all - *counted) as u64, Ordering::Relaxed);
            *counted = all;
        }
    }

    fn is_spent(&self) -> bool {
        self.tests.is_spent()
            || self.found.load(Ordering::Relaxed) > self.most
            || self.cancel.is_cancelled()
    }
}

/// Searches for changes, and their memory.
#[derive(Debug, Default)]
pub(super) struct Changes {
    /// The changed boxes, in the order in which they changed.
    centres: Vec<Centre>,
    /// The order in which they are looked around; empty where that is the same.
    order: Vec<u32>,
    tasks: Vec<Search>,
}

/// A range of changed boxes, and what was found around them.
#[derive(Debug, Default)]
struct Search {
    boxes: std::ops::Range<usize>,
    tested: u64,
    found: Difference,
    batches: [Around; BATCHES],
}

/// A batch of boxes that are looked around.
#[derive(Debug, Default)]
struct Around {
    /// The box of each probe, and what of it.
    centres: Vec<(Centre, Seen)>,
    probes: Vec<Probe>,
    looked: Looked,
}

/// A box that is looked around, on a cache line of its own.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Centre {
    index: u32,
    b: WasIs,
}

/// What is looked around of a box that has changed.
#[derive(Clone, Copy, Debug)]
enum Seen {
    /// What it was and is, at once.
    Both,
    Was,
    Is,
}

impl Changes {
    pub fn allocated_bytes(&self) -> usize {
        let of_task = |task: &Search| {
            (task.found.begun.capacity() + task.found.ended.capacity()) * size_of::<Pair>()
        };
        self.centres.capacity() * size_of::<Centre>()
            + self.order.capacity() * size_of::<u32>()
            + self.tasks.iter().map(of_task).sum::<usize>()
    }

    /// What differs from then to now, in no order, some of it twice; and how many boxes were tested. `None` where
    /// these would be more than [`most_tests`], what differs more than so many pairs, or nobody waits for them.
    pub fn find(
        &mut self,
        cells: &Cells,
        store: &Store,
        threads: usize,
        (most, cancel): (u64, &Cancel),
    ) -> Option<(Difference, u64)> {
        let Self { centres, order, tasks } = self;
        let changed = store.changed();
        centres.resize(changed.len(), Centre::NONE);
        zip_in_parts(centres, changed, TASK_BOXES, threads, |centres, changed| {
            for (at, (centre, index)) in centres.iter_mut().zip(changed).enumerate() {
                if let Some(ahead) = changed.get(at + BATCH) {
                    store.ask_for(*ahead);
                }
                *centre = Centre { index: *index, b: WasIs::of(*index, store) };
            }
        });
        order.clear();
        let count = changed.len();
        if count >= SORTED_BOXES && count * SORTED_SHARE > store.boxes().len() {
            let numbered = changed.iter().zip(0u32..);
            let positions = numbered.map(|(index, number)| [cells.position(*index), number]);
            in_order_of(positions.collect(), order);
        }
        let parts = part_count(count, TASK_BOXES, threads);
        tasks.resize_with(parts, Search::default);
        let border = |part: usize| count * part / parts;
        for (part, task) in tasks.iter_mut().enumerate() {
            task.boxes = border(part)..border(part + 1);
        }
        let (centres, order) = (centres.as_slice(), order.as_slice());
        let bound = &Bound::new(most_tests(store, count), most, cancel);
        for_each_in_parts(tasks, parts, |task| task.run(centres, order, cells, store, bound));
        if bound.is_spent() {
            for task in tasks {
                task.found = Difference::default();
            }
            return None;
        }
        let mut all = Difference::default();
        let mut tested = 0;
        for task in tasks {
            all.begun.append(&mut task.found.begun);
            all.ended.append(&mut task.found.ended);
            tested += task.tested;
        }
        Some((all, tested))
    }
}

/// Tests of so many searches after which the whole scene is sooner culled.
fn most_tests(store: &Store, searches: usize) -> i64 {
    TESTS_A_SEARCH * searches as i64 + TESTS_A_BOX * store.boxes().len() as i64
}

/// Whether two valid boxes overlap, about: whether they are better looked around at once.
#[inline]
fn are_near(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis])
}

impl Centre {
    const NONE: Self = {
        let none = BoxState { b: Aabb::EMPTY, is_static: false };
        Self { index: 0, b: WasIs::unchanged(none) }
    };

    /// Looks around it: once, where it has not gone far.
    fn probes(&self, mut add: impl FnMut(Seen, Probe)) {
        let (was, is) = (self.b.was.b, self.b.is.b);
        match (is_valid(&was), is_valid(&is)) {
            (false, false) => {}
            (true, true) if are_near(&was, &is) => {
                add(Seen::Both, Probe::Both { was, is, dismisses: self.b.is_same() });
            }
            (was_valid, is_valid) => {
                if was_valid {
                    add(Seen::Was, Probe::One { here: was, elsewhere: is });
                }
                if is_valid {
                    add(Seen::Is, Probe::One { here: is, elsewhere: was });
                }
            }
        }
    }

    /// Says whether its pair with a candidate began or ended.
    #[inline]
    fn report_changes(
        &self,
        seen: Seen,
        &Candidate { word, is_sure, .. }: &Candidate,
        store: &Store,
        found: &mut Difference,
    ) {
        let other = word & INDEX;
        let is_static = word & STATIC != 0;
        let has_changed = word & CHANGED != 0 && store.states.has(other, states::CHANGED);
        if other == self.index || has_changed && other < self.index {
            return;
        }
        let overlaps = match seen {
            // It has not changed, and overlaps what is seen alone.
            Seen::Was if is_sure => [!(self.b.was.is_static && is_static), false],
            Seen::Is if is_sure => [false, !(self.b.is.is_static && is_static)],
            _ if has_changed => self.b.overlaps(&WasIs::of(other, store)),
            _ => {
                let same = BoxState { b: store.boxes()[other as usize], is_static };
                self.b.overlaps(&WasIs::unchanged(same))
            }
        };
        let pair = pair(self.index, other);
        let [begins, ends] = change(pair, overlaps, store);
        if begins {
            found.begun.push(pair);
        }
        if ends {
            found.ended.push(pair);
        }
    }
}

impl Search {
    /// Looks around all boxes, while tests are left.
    fn run(
        &mut self,
        centres: &[Centre],
        order: &[u32],
        cells: &Cells,
        store: &Store,
        bound: &Bound<'_>,
    ) {
        let Self { boxes, tested, found, batches } = self;
        *tested = 0;
        found.begun.clear();
        found.ended.clear();
        let count = boxes.len().div_ceil(BATCH);
        // The boxes of a batch, by their places among all.
        let of_batch = |number: usize| {
            let start = (boxes.start + number * BATCH).min(boxes.end);
            let slots = start..(start + BATCH).min(boxes.end);
            slots.map(|slot| order.get(slot).map_or(slot, |centre| *centre as usize))
        };
        let (mut lot, mut pace, mut counted) = (TestLot::default(), Pace::default(), 0);
        in_stages(batches, count, |stage, number, batch| {
            match stage {
                0 => {
                    of_batch(number + 1).for_each(|centre| ask_for(centres, centre as u32));
                    batch.begin(of_batch(number).map(|at| centres[at]), cells);
                }
                1 => {
                    let searches = &mut batch.looked.searches;
                    cells.go_on(searches);
                    lot.take(searches.tested() as i64, &bound.tests);
                    bound.cancel.look_after(searches.tested(), &mut pace);
                    return !bound.is_spent();
                }
                2 => {
                    *tested += batch.finish(cells, store);
                    lot.take(batch.looked.candidate_tests(), &bound.tests);
                }
                _ => {
                    for ((centre, seen), candidate) in batch.found() {
                        centre.report_changes(*seen, candidate, store, found);
                    }
                    bound.count(found, &mut counted);
                }
            }
            true
        });
    }
}

impl Around {
    /// Begins to look around boxes.
    fn begin(&mut self, around: impl Iterator<Item = Centre>, cells: &Cells) {
        let Self { centres, probes, looked } = self;
        centres.clear();
        probes.clear();
        for centre in around {
            centre.probes(|seen, probe| {
                centres.push((centre, seen));
                probes.push(probe);
            });
        }
        cells.begin(probes, &mut looked.searches);
    }

    /// Finds the candidates. Returns how many boxes were tested.
    fn finish(&mut self, cells: &Cells, store: &Store) -> u64 {
        self.looked.finish(cells, store.boxes().len(), |word| {
            if word & CHANGED != 0 {
                store.ask_for(word & INDEX);
            } else {
                store.ask_for_box(word & INDEX);
            }
        })
    }

    /// Each candidate and the box that it was found around.
    fn found(&self) -> impl Iterator<Item = (&(Centre, Seen), &Candidate)> {
        self.looked.candidates.iter().map(|this| (&self.centres[this.probe as usize], this))
    }
}

/// Adds numbers in the order of places, which stand before them: by counting, digit by digit.
pub(super) fn in_order_of(mut slots: Vec<[u32; 2]>, order: &mut Vec<u32>) {
    const DIGIT: u32 = 11;
    let mut sorted = vec![[0; 2]; slots.len()];
    let most = slots.iter().map(|[slot, _]| *slot).max().unwrap_or(0);
    for shift in (0..u32::BITS - most.leading_zeros()).step_by(DIGIT as usize) {
        let digit = |slot: u32| (slot >> shift & ((1 << DIGIT) - 1)) as usize;
        let mut starts = [0u32; 1 << DIGIT];
        for [slot, _] in &slots {
            starts[digit(*slot)] += 1;
        }
        starts_of(&mut starts);
        for this in &slots {
            let start = &mut starts[digit(this[0])];
            sorted[*start as usize] = *this;
            *start += 1;
        }
        std::mem::swap(&mut slots, &mut sorted);
    }
    order.extend(slots.iter().map(|[_, number]| *number));
}
