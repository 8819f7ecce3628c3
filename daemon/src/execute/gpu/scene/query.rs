//! Queries: boxes that are no part of a scene against all that are.
//!
//! There is no structure of the scene to look into, and none is needed: the queries are the entries of a
//! grid, in records behind the scene's, and every box looks once whether one of them is near. That is the
//! search of an edit that changes as many boxes, in one submission, at the end of which the records are
//! without a box again. So nothing that an edit knows or tells has changed.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::{Edit, Indices, Sets, Step, sort_row};
use pairmask_shaders::layouts::SceneMode;

use super::changes::Found;
use super::memory::{Blocks, RECORD_BYTES};
use super::plan::{MOST_SLOTS, Question, Room, Sizes};
use super::roster::Marks;
use super::search::{self, Task};
use super::times::{Clock, EditTimes};
use super::{ENGINE, GpuScene, Pair, wide};
use crate::execute::gpu::error::GpuError;

/// Most queries of a submission: their records, 16 MiB, are room that edits do not need.
const QUERIES_TOGETHER: usize = 1 << 18;

/// Pairs from which several threads sort: one sorts so many in the time in which others wake.
const MANY_PAIRS: usize = 60_000;
/// With fewer pairs than one for so many queries, a plain sort is sooner done than a walk over all queries.
const QUERIES_A_PAIR: usize = 8;

impl GpuScene {
    /// The boxes that each of `queries` overlaps, switched on, static ones too: pairs of the query's number
    /// and the box's index, in order. What `found` held is dropped. Returns how many boxes were tested.
    /// No later edit tells anything else for it.
    ///
    /// # Errors
    /// [`CullError`]; `found` is empty then. After [`CullError::DeviceLost`] the scene is to be dropped. Where
    /// memory is short, or queries crowd one place too much, the scene is what it was.
    pub fn query(&mut self, queries: &[Aabb], found: &mut Vec<[u32; 2]>) -> Result<u64, CullError> {
        found.clear();
        self.times = EditTimes::default();
        let slots = self.roster.len();
        if self.roster.active() == 0 {
            return Ok(0);
        }
        let most = (self.tools.binding_bytes / RECORD_BYTES).min(MOST_SLOTS) as usize;
        let room = most.saturating_sub(slots);
        if room == 0 && !queries.is_empty() {
            let bytes = (slots as u64 + 1) * RECORD_BYTES;
            return Err(self.tools.gpu.cull_error(ENGINE, &GpuError::OutOfMemory { bytes }));
        }
        let mut tested = 0;
        for (part, queries) in queries.chunks(room.clamp(1, QUERIES_TOGETHER)).enumerate() {
            let first = part * room.min(QUERIES_TOGETHER);
            match self.query_together(queries, first as u32, found) {
                Ok(more) => tested += more,
                Err(error) => {
                    found.clear();
                    return Err(error);
                }
            }
        }
        Ok(tested)
    }

    /// Queries of one submission, numbered from `first` on; their pairs go behind those found.
    fn query_together(
        &mut self,
        queries: &[Aabb],
        first: u32,
        found: &mut Vec<Pair>,
    ) -> Result<u64, CullError> {
        let tools = Arc::clone(&self.tools);
        let gpu_error = |error: GpuError| tools.gpu.cull_error(ENGINE, &error);
        let mut clock = Clock::start();
        let (slots, count) = (self.roster.len() as u64, queries.len() as u64);
        let mut replaced = false;
        self.memory.make_records(&tools, slots + count, &mut replaced).map_err(gpu_error)?;
        let indices = Indices::Range { first: slots as u32, count: count as u32 };
        let steps = [Step::Set(Sets { indices, boxes: queries })];
        let uploaded = self
            .upload
            .place(&tools.gpu, Edit { steps: &steps }, &Marks::new(), &mut replaced)
            .map_err(gpu_error)?;
        clock.lap(&mut self.times.upload);
        let question = Question {
            mode: SceneMode::Query,
            slots: slots + count,
            active: self.roster.active() as u64 + count,
            changed: count,
        };
        self.layouts.note_queries(&question, queries);
        let layout = self.layouts.layout(&question);
        let sizes = Sizes::of(&question, &layout);
        let mut room = Room::expected(&question, self.rooms.0[question.mode as usize]);
        loop {
            let blocks =
                self.memory.blocks(&tools, &sizes, room, &mut replaced).map_err(gpu_error)?;
            if std::mem::take(&mut replaced) {
                self.frames.clear();
            }
            let task = Task {
                question,
                searches: true,
                layout,
                sizes,
                epoch: self.epoch,
                naming: 0,
                edit: &uploaded,
                // Each time: the last submission has emptied their records.
                applies: true,
                blocks: &blocks,
            };
            clock.lap(&mut self.times.plan);
            let summary = self.frames.run(&tools, &task).map_err(gpu_error)?;
            self.times.submissions += 1;
            clock.lap(&mut self.times.gpu);
            if tools.profiled {
                self.times.stages = self.frames.step_times().map_err(gpu_error)?;
            }
            let made = task.room_made(&tools);
            let (pairs, tested) = (wide(summary.found), wide(summary.tested));
            if u64::from(summary.entries) > made.entries {
                room.entries = u64::from(summary.entries);
                continue;
            }
            if summary.tested[1] >= search::BUDGET {
                self.layouts.note_search(&question, &summary, tested);
                return Err(CullError::TooCrowded { engine: ENGINE });
            }
            if pairs > made.pairs {
                let needed_bytes = pairs.saturating_mul(size_of::<Pair>() as u64);
                if needed_bytes > tools.binding_bytes {
                    return Err(ReserveError::OutOfMemory { needed_bytes }.into());
                }
                room.pairs = pairs;
                continue;
            }
            self.layouts.note_search(&question, &summary, tested);
            self.rooms.0[question.mode as usize] =
                Room { entries: u64::from(summary.entries), pairs };
            self.append(&blocks, pairs as usize, queries.len(), first, found)?;
            clock.lap(&mut self.times.sort);
            return Ok(tested);
        }
    }

    /// Reads `count` pairs that were found, and writes them in order behind the others.
    fn append(
        &mut self,
        blocks: &Blocks,
        count: usize,
        queries: usize,
        first: u32,
        found: &mut Vec<Pair>,
    ) -> Result<(), CullError> {
        let needed_bytes = (count * size_of::<Pair>()) as u64;
        let no_memory = |_| CullError::Reserve(ReserveError::OutOfMemory { needed_bytes });
        let read = |at: usize, to: &mut [Pair]| {
            blocks.found.read((at * size_of::<Pair>()) as u64, to);
        };
        let before = found.len();
        found.try_reserve(count).map_err(no_memory)?;
        let threads = self.threads();
        if threads > 1 && count >= MANY_PAIRS {
            let list = Found { read: &read, count, n: queries as u32 };
            if before == 0 {
                self.sorter.pairs(&list, threads, found);
            } else {
                let mut more = Vec::new();
                more.try_reserve(count).map_err(no_memory)?;
                self.sorter.pairs(&list, threads, &mut more);
                found.append(&mut more);
            }
        } else {
            found.resize(before + count, [0; 2]);
            let sorted = &mut found[before..];
            self.query_sorter.sort(&read, queries, sorted);
        }
        if first > 0 {
            found[before..].iter_mut().for_each(|pair| pair[0] += first);
        }
        Ok(())
    }
}

/// Sorts pairs by query and index with one pass over them: a query is a place in a table of counts. Keeps its
/// memory.
#[derive(Debug, Default)]
pub(super) struct QuerySorter {
    read: Vec<Pair>,
    /// Where the next pair of each query goes.
    next: Vec<u32>,
}

impl QuerySorter {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.read.capacity() * size_of::<Pair>() + self.next.capacity() * size_of::<u32>()
    }

    /// Writes the pairs of a list, of as many as `sorted` has, in order. `read` copies pairs from a place of
    /// the list on.
    fn sort(&mut self, read: &impl Fn(usize, &mut [Pair]), queries: usize, sorted: &mut [Pair]) {
        if sorted.len() * QUERIES_A_PAIR < queries {
            read(0, sorted);
            sorted.sort_unstable();
            return;
        }
        self.read.resize(sorted.len(), [0; 2]);
        read(0, &mut self.read);
        self.next.clear();
        self.next.resize(queries.max(1), 0);
        // What the device wrote is below `queries`; were it not, it would count with the last.
        let last = self.next.len() - 1;
        for pair in &self.read {
            self.next[(pair[0] as usize).min(last)] += 1;
        }
        let mut start = 0;
        for next in &mut self.next {
            start += std::mem::replace(next, start);
        }
        for pair in &self.read {
            let next = &mut self.next[(pair[0] as usize).min(last)];
            sorted[*next as usize] = *pair;
            *next += 1;
        }
        // Each place is now the end of its query.
        let mut start = 0;
        for end in &self.next {
            let row = &mut sorted[start..*end as usize];
            if row.len() > 1 {
                sort_row(row);
            }
            start = *end as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_any_number_of_queries_are_sorted() {
        let mut sorter = QuerySorter::default();
        for (count, queries) in
            [(0, 0), (0, 7), (1, 1), (3, 1), (5, 70), (300, 3), (4_000, 500), (70, 10_000)]
        {
            let number = |i: usize| i.wrapping_mul(0x9e37_79b9) >> 7;
            let source: Vec<Pair> = (0..count)
                .map(|i| [(number(i) % queries.max(1)) as u32, number(i + count) as u32])
                .collect();
            let read = |at: usize, to: &mut [Pair]| to.copy_from_slice(&source[at..at + to.len()]);
            let mut sorted = vec![[7; 2]; count];
            sorter.sort(&read, queries, &mut sorted);
            let mut expected = source.clone();
            expected.sort_unstable();
            assert!(sorted == expected, "{count} pairs of {queries} queries");
        }
    }
}
