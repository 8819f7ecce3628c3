//! Looking around queries in cells.

use super::Room;
use crate::aabb::{Aabb, KeyBox};
use crate::engine::CullError;
use crate::engine::strips::{in_parts, part_count};
use crate::floats;
use crate::scene::cells::{CHANGED, Candidate, Cells, INDEX, Probe, Searches, is_solid};
use crate::scene::fetch::ask_for;
use crate::scene::history::in_order_of;
use crate::scene::pair_list::{Pair, sort_row};

/// Queries of a task, at least: a search takes about 0.2 µs.
const TASK_QUERIES: usize = 128;
/// Queries that are looked around at a time.
const BATCH: usize = 16;
/// Fewest queries that are looked around by place, and the least share of the boxes, one in so many: below, two
/// that follow one another share no memory.
const SORTED_QUERIES: usize = 512;
const SORTED_SHARE: usize = 128;
/// Batches that are under way at a time: each is a step behind the one after it.
const BATCHES: usize = 4;

/// A range of queries, and what was found around them.
#[derive(Default)]
struct Task<'a> {
    /// Numbers of queries.
    queries: &'a [u32],
    tested: u64,
    found: Vec<Pair>,
    batches: [Batch; BATCHES],
}

/// Queries that are looked around together.
#[derive(Default)]
struct Batch {
    /// The query of each probe.
    numbers: Vec<u32>,
    keys: Vec<KeyBox>,
    probes: Vec<Probe>,
    searches: Searches,
    candidates: Vec<Candidate>,
}

/// Finds the boxes that queries overlap, in cells that hold them all. Returns how many were tested.
pub(super) fn find(
    cells: &Cells,
    boxes: &[Aabb],
    queries: &[Aabb],
    threads: usize,
    room: &Room,
    found: &mut Vec<Pair>,
) -> Result<u64, CullError> {
    let count = queries.len();
    let is_sorted = count >= SORTED_QUERIES && count * SORTED_SHARE > boxes.len();
    let order = if is_sorted { by_place(cells, queries) } else { (0..count as u32).collect() };
    let parts = part_count(count, TASK_QUERIES, threads);
    let border = |part: usize| count * part / parts;
    let mut tasks: Vec<Task<'_>> = (0..parts)
        .map(|part| Task { queries: &order[border(part)..border(part + 1)], ..Task::default() })
        .collect();
    let run = |tasks: &mut [Task<'_>]| {
        for task in tasks {
            task.run(cells, boxes, queries, room);
        }
    };
    in_parts(tasks.as_mut_slice(), parts, &run, &|(), ()| ());
    room.check()?;
    super::reserve(found, tasks.iter().map(|task| task.found.len()).sum())?;
    if is_sorted {
        by_query(&tasks, count, found);
    } else {
        for task in &tasks {
            found.extend_from_slice(&task.found);
        }
    }
    Ok(tasks.iter().map(|task| task.tested).sum())
}

/// Numbers of queries in the order of the cells that they begin in.
fn by_place(cells: &Cells, queries: &[Aabb]) -> Vec<u32> {
    let place = |(number, query)| [cells.near(query), number];
    let places = floats::with_default(|| (0u32..).zip(queries).map(place).collect());
    let mut order = Vec::with_capacity(queries.len());
    in_order_of(places, &mut order);
    order
}

/// Puts the pairs of all tasks in the order of their queries. Those of a query stand together.
fn by_query(tasks: &[Task<'_>], queries: usize, found: &mut Vec<Pair>) {
    let mut starts = vec![0u32; queries];
    let pairs = || tasks.iter().flat_map(|task| &task.found);
    for [query, _] in pairs() {
        starts[*query as usize] += 1;
    }
    let mut next = 0;
    for start in &mut starts {
        next += std::mem::replace(start, next);
    }
    found.resize(next as usize, [0; 2]);
    for pair in pairs() {
        let start = &mut starts[pair[0] as usize];
        found[*start as usize] = *pair;
        *start += 1;
    }
}

impl Task<'_> {
    fn run(&mut self, cells: &Cells, boxes: &[Aabb], queries: &[Aabb], room: &Room) {
        let Self { queries: numbers, tested, found, batches } = self;
        let count = numbers.len().div_ceil(BATCH);
        for step in 0..count + BATCHES - 1 {
            if room.is_spent() {
                return;
            }
            // The latest batch first: what it asks for has the time of all others to come.
            if step < count {
                let some = &numbers[step * BATCH..numbers.len().min((step + 1) * BATCH)];
                batches[step % BATCHES].begin(some, queries, cells);
            }
            let earlier = |steps: usize| {
                let number = step.checked_sub(steps).filter(|number| *number < count);
                number.map(|number| number % BATCHES)
            };
            if let Some(number) = earlier(1) {
                cells.go_on(&mut batches[number].searches);
            }
            if let Some(number) = earlier(2) {
                *tested += batches[number].finish(cells, boxes);
            }
            if let Some(number) = earlier(3) {
                let before = found.len();
                batches[number].tell(boxes, found);
                if !room.take(found.len() - before) {
                    return;
                }
            }
        }
    }
}

impl Batch {
    fn begin(&mut self, some: &[u32], queries: &[Aabb], cells: &Cells) {
        let Self { numbers, keys, probes, searches, .. } = self;
        numbers.clear();
        keys.clear();
        probes.clear();
        for &number in some {
            // A copy: another process may write queries while they are read.
            let query = queries[number as usize];
            if is_solid(&query) {
                numbers.push(number);
                keys.push(KeyBox::from(&query));
                probes.push(Probe::One { here: query, elsewhere: Aabb::EMPTY });
            }
        }
        cells.begin(probes, searches);
    }

    /// Finds the candidates. Returns how many boxes were tested.
    fn finish(&mut self, cells: &Cells, boxes: &[Aabb]) -> u64 {
        let Self { searches, candidates, .. } = self;
        candidates.clear();
        let tested = cells.finish(searches, candidates);
        // A slot may be that of an index that is no more: its box was removed at the end.
        candidates.retain(|candidate| ((candidate.word & INDEX) as usize) < boxes.len());
        for Candidate { word, .. } in candidates.iter().filter(|this| !this.is_sure) {
            // One box in three lies on two lines.
            ask_for(boxes, word & INDEX);
            ask_for(boxes, (word & INDEX) + 1);
        }
        tested
    }

    /// Adds the pairs, in order. The candidates of a query stand together.
    fn tell(&self, boxes: &[Aabb], found: &mut Vec<Pair>) {
        for of_one in self.candidates.chunk_by(|a, b| a.probe == b.probe) {
            let at = of_one[0].probe as usize;
            let (number, keys, start) = (self.numbers[at], &self.keys[at], found.len());
            let mut may_repeat = false;
            for &Candidate { word, is_sure, .. } in of_one {
                let index = word & INDEX;
                if is_sure || keys.overlaps(&KeyBox::from(&boxes[index as usize])) {
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
    }
}
