//! Looking around queries in cells.

use std::ops::Range;

use super::Room;
use crate::aabb::{Aabb, KeyBox};
use crate::cancel::Pace;
use crate::engine::CullError;
use crate::fetch::ask_for;
use crate::floats;
use crate::scene::cells::{
    BATCH, BATCHES, CHANGED, Candidate, Cells, INDEX, Looked, in_stages, is_valid,
};
use crate::scene::history::in_order_of;
use crate::scene::pair_list::{Pair, sort_row};
use crate::team::{for_each_in_parts, part_count};
use crate::test_budget::TestLot;

/// Queries of a task, at least: some 25 µs.
const TASK_QUERIES: usize = 128;
/// Fewest boxes around which queries go by place: those of fewer lie in the caches, and to sort the queries, on
/// one thread, takes longer than it saves.
const SORTED_BOXES: usize = 1 << 18;
/// The same for the share of queries, one for so many boxes: below, two that follow one another share no memory.
const SORTED_SHARE: usize = 32;
/// Boxes that the queries of a batch may test together, 768 KiB of candidates: where there are more, each query
/// is looked around by itself, so that no more candidates are in memory than those of a query of each thread.
const MANY_TESTS: u64 = 65_536;
/// Candidates that a batch keeps room for between queries: 1 MiB.
const KEPT_CANDIDATES: usize = (1 << 20) / size_of::<Candidate>();

/// The memory of searches, kept from one to the next: to get it anew takes a tenth of their time on one thread,
/// and more on several, which get it together.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// Numbers of queries, in the order in which they are looked around.
    order: Vec<u32>,
    /// Where the next pair of each query goes.
    starts: Vec<u32>,
    tasks: Vec<Task>,
}

/// A range of queries, and what was found around them.
#[derive(Debug, Default)]
struct Task {
    /// Their places in the order.
    queries: Range<usize>,
    tested: u64,
    found: Vec<Pair>,
    batches: [Batch; BATCHES],
}

/// Queries that are looked around together.
#[derive(Debug, Default)]
struct Batch {
    /// Queries that overlap anything.
    numbers: Vec<u32>,
    here: Vec<Aabb>,
    looked: Looked,
}

impl Memory {
    /// Bytes that are allocated for searches, what was found, and the order of queries.
    pub fn allocated_bytes(&self) -> usize {
        let of_task = |task: &Task| {
            let batches: usize = task.batches.iter().map(Batch::allocated_bytes).sum();
            task.found.capacity() * size_of::<Pair>() + batches
        };
        (self.order.capacity() + self.starts.capacity()) * size_of::<u32>()
            + self.tasks.iter().map(of_task).sum::<usize>()
    }
}

/// Finds the boxes that queries overlap, in cells that hold them all. Returns how many were tested; `None` where the cells
/// do not part them: what `room` has counted then is of no use.
pub(super) fn find(
    cells: &Cells,
    boxes: &[Aabb],
    queries: &[Aabb],
    threads: usize,
    room: &Room<'_>,
    memory: &mut Memory,
    found: &mut Vec<Pair>,
) -> Result<Option<u64>, CullError> {
    let Memory { order, starts, tasks } = memory;
    let count = queries.len();
    let is_sorted = boxes.len() >= SORTED_BOXES && count * SORTED_SHARE > boxes.len();
    order.clear();
    if is_sorted {
        let slot = |(number, query)| [cells.near(query), number];
        let slots = floats::with_default(|| (0u32..).zip(queries).map(slot).collect());
        in_order_of(slots, order);
    } else {
        order.extend(0..count as u32);
    }
    let parts = part_count(count, TASK_QUERIES, threads);
    tasks.resize_with(parts, Task::default);
    let border = |part: usize| count * part / parts;
    for (part, task) in tasks.iter_mut().enumerate() {
        task.queries = border(part)..border(part + 1);
    }
    let order = order.as_slice();
    for_each_in_parts(tasks, parts, |task| task.run(order, cells, boxes, queries, room));
    tasks.iter_mut().flat_map(|task| &mut task.batches).for_each(Batch::give_back);
    room.check()?;
    if room.tests.is_spent() {
        return Ok(None);
    }
    super::reserve(found, tasks.iter().map(|task| task.found.len()).sum())?;
    if is_sorted {
        super::by_query(|| tasks.iter().flat_map(|task| &task.found), count, starts, found);
    } else {
        for task in tasks.iter() {
            found.extend_from_slice(&task.found);
        }
    }
    Ok(Some(tasks.iter().map(|task| task.tested).sum()))
}

impl Task {
    fn run(
        &mut self,
        order: &[u32],
        cells: &Cells,
        boxes: &[Aabb],
        queries: &[Aabb],
        room: &Room<'_>,
    ) {
        let Self { queries: of_task, tested, found, batches } = self;
        *tested = 0;
        found.clear();
        let numbers = &order[of_task.clone()];
        let count = numbers.len().div_ceil(BATCH);
        let (mut lot, mut pace) = (TestLot::default(), Pace::default());
        in_stages(batches, count, |stage, number, batch| match stage {
            0 => {
                let some = &numbers[number * BATCH..numbers.len().min((number + 1) * BATCH)];
                batch.begin(some, queries, cells);
                !room.is_spent() && !room.tests.is_spent()
            }
            1 => {
                cells.go_on(&mut batch.looked.searches);
                let tested = batch.looked.searches.tested();
                lot.take(tested as i64, &room.tests);
                room.cancel.look_after(tested, &mut pace);
                true
            }
            2 => {
                *tested += if batch.is_large() { 0 } else { batch.finish(cells, boxes) };
                true
            }
            _ if batch.is_large() => batch.find_one_by_one(cells, boxes, room, tested, found),
            _ => batch.report_within(boxes, room, found),
        });
    }
}

impl Batch {
    fn begin(&mut self, some: &[u32], queries: &[Aabb], cells: &Cells) {
        let Self { numbers, here, looked } = self;
        numbers.clear();
        here.clear();
        for &number in some {
            // A copy: another process may write queries while they are read.
            let query = queries[number as usize];
            if is_valid(&query) {
                numbers.push(number);
                here.push(query);
            }
        }
        cells.begin_around(here, &mut looked.searches);
    }

    /// Whether its queries, once they went on, are to be looked around one by one.
    const fn is_large(&self) -> bool {
        self.here.len() > 1 && self.looked.searches.tested() > MANY_TESTS
    }

    /// Looks around the queries one by one, and adds their pairs. Whether there was room for them.
    fn find_one_by_one(
        &mut self,
        cells: &Cells,
        boxes: &[Aabb],
        room: &Room<'_>,
        tested: &mut u64,
        found: &mut Vec<Pair>,
    ) -> bool {
        let (numbers, here) = (std::mem::take(&mut self.numbers), std::mem::take(&mut self.here));
        let is_within = numbers.iter().zip(&here).all(|(number, query)| {
            self.numbers.clear();
            self.numbers.push(*number);
            self.here.clear();
            self.here.push(*query);
            cells.begin_around(&self.here, &mut self.looked.searches);
            cells.go_on(&mut self.looked.searches);
            *tested += self.finish(cells, boxes);
            self.report_within(boxes, room, found)
        });
        (self.numbers, self.here) = (numbers, here);
        self.give_back();
        is_within
    }

    /// Gives back the memory of more candidates than most queries have.
    fn give_back(&mut self) {
        if self.looked.candidates.capacity() > KEPT_CANDIDATES {
            self.looked.candidates.clear();
            self.looked.candidates.shrink_to(KEPT_CANDIDATES);
        }
    }

    fn allocated_bytes(&self) -> usize {
        self.numbers.capacity() * size_of::<u32>()
            + self.here.capacity() * size_of::<Aabb>()
            + self.looked.searches.allocated_bytes()
            + self.looked.candidates.capacity() * size_of::<Candidate>()
    }

    /// Finds the candidates. Returns how many boxes were tested.
    fn finish(&mut self, cells: &Cells, boxes: &[Aabb]) -> u64 {
        self.looked.finish(cells, boxes.len(), |word| {
            // One box in three lies on two lines.
            ask_for(boxes, word & INDEX);
            ask_for(boxes, (word & INDEX) + 1);
        })
    }

    /// Adds the pairs, in order: the candidates of a query stand together. Whether there was room for them.
    fn report_within(&self, boxes: &[Aabb], room: &Room<'_>, found: &mut Vec<Pair>) -> bool {
        let before = found.len();
        for of_one in self.looked.candidates.chunk_by(|a, b| a.probe == b.probe) {
            let at = of_one[0].probe as usize;
            let (number, here, start) = (self.numbers[at], &self.here[at], found.len());
            let mut may_repeat = false;
            for &Candidate { word, is_sure, .. } in of_one {
                let index = word & INDEX;
                if is_sure || KeyBox::from(here).overlaps(&KeyBox::from(&boxes[index as usize])) {
                    found.push([number, index]);
                    may_repeat |= word & CHANGED != 0;
                }
            }
            sort_row(&mut found[start..]);
            if may_repeat {
                // A box that has gone far has a slot where it was, and one where it is.
                let mut kept = start + 1;
                for at in start + 1..found.len() {
                    if found[at] != found[kept - 1] {
                        found[kept] = found[at];
                        kept += 1;
                    }
                }
                found.truncate(kept);
            }
        }
        room.take(found.len() - before, self.looked.candidate_tests())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Cancel;

    #[test]
    fn queries_that_overlap_very_many_boxes_find_them_all_and_keep_little_memory() {
        let count = 50_000;
        let mut boxes = vec![Aabb::new([0.0; 3], [1.0; 3]); count];
        boxes.push(Aabb::new([40.0; 3], [41.0; 3]));
        let mut queries = vec![Aabb::new([0.5; 3], [2.0; 3]); 20];
        queries[3] = Aabb::EMPTY;
        queries[7] = Aabb::new([40.5; 3], [42.0; 3]);
        let cells = Cells::of(&boxes, |_| false, 1);
        let mut memory = Memory::default();
        let mut ask = |queries: &[Aabb], most: u64| {
            let cancel = Cancel::never();
            let (room, mut found) = (Room::new(most, queries.len(), count, &cancel), Vec::new());
            let tested = find(&cells, &boxes, queries, 1, &room, &mut memory, &mut found);
            tested.map(|tested| (tested.expect("not crowded"), found))
        };
        let (tested, found) = ask(&queries, u64::from(u32::MAX)).expect("room");
        let (mut tested_alone, mut expected) = (0, Vec::new());
        for (number, query) in (0..).zip(&queries) {
            let (tested, alone) = ask(std::slice::from_ref(query), u64::MAX).expect("room");
            tested_alone += tested;
            expected.extend(alone.iter().map(|[_, index]| [number, *index]));
        }
        assert_eq!((tested, found.len()), (tested_alone, 18 * count + 1));
        assert!(found == expected);
        assert!(ask(&queries, 3 * count as u64).is_err(), "more pairs than there is room for");
        let batches = memory.tasks.iter().flat_map(|task| &task.batches);
        let most = batches.map(|batch| batch.looked.candidates.capacity()).max();
        assert!(most.is_some_and(|most| most <= KEPT_CANDIDATES), "{most:?}");
    }
}
