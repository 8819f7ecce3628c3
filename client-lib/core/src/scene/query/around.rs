//! Looking around queries in cells.

use super::Room;
use crate::aabb::{Aabb, KeyBox};
use crate::engine::CullError;
use crate::engine::strips::{in_parts, part_count};
use crate::scene::cells::{CHANGED, Candidate, Cells, INDEX, Probe, Searches, is_solid};
use crate::scene::fetch::ask_for;
use crate::scene::pair_list::{Pair, sort_row};

/// Queries of a task, at least: a search takes about 0.2 µs.
const TASK_QUERIES: usize = 128;
/// Queries that are looked around at a time.
const BATCH: usize = 16;
/// Batches that are under way at a time: each is a step behind the one after it.
const BATCHES: usize = 4;

/// A range of queries, and what was found around them.
#[derive(Default)]
struct Task {
    queries: std::ops::Range<usize>,
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
    let parts = part_count(queries.len(), TASK_QUERIES, threads);
    let border = |part: usize| queries.len() * part / parts;
    let mut tasks: Vec<Task> = (0..parts)
        .map(|part| Task { queries: border(part)..border(part + 1), ..Task::default() })
        .collect();
    let run = |tasks: &mut [Task]| {
        for task in tasks {
            task.run(cells, boxes, queries, room);
        }
    };
    in_parts(tasks.as_mut_slice(), parts, &run, &|(), ()| ());
    room.check()?;
    super::reserve(found, tasks.iter().map(|task| task.found.len()).sum())?;
    tasks.iter().for_each(|task| found.extend_from_slice(&task.found));
    Ok(tasks.iter().map(|task| task.tested).sum())
}

impl Task {
    fn run(&mut self, cells: &Cells, boxes: &[Aabb], queries: &[Aabb], room: &Room) {
        let Self { queries: range, tested, found, batches } = self;
        let count = range.len().div_ceil(BATCH);
        for step in 0..count + BATCHES - 1 {
            if room.is_spent() {
                return;
            }
            // The latest batch first: what it asks for has the time of all others to come.
            if step < count {
                let start = range.start + step * BATCH;
                batches[step % BATCHES].begin(
                    start as u32,
                    &queries[start..range.end.min(start + BATCH)],
                    cells,
                );
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
    fn begin(&mut self, first: u32, queries: &[Aabb], cells: &Cells) {
        let Self { numbers, keys, probes, searches, .. } = self;
        numbers.clear();
        keys.clear();
        probes.clear();
        // Copies: another process may write queries while they are read.
        for (number, query) in (first..).zip(queries.iter().copied()) {
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
