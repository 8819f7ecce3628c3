//! Queries: boxes that are no part of a scene against all that are. The first after an edit are the entries of a grid;
//! the second build a grid of all boxes, which stands until the next edit (GPU.md, "Scenes"). Nothing that an edit knows
//! or reports changes.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::states::STILL;
use pairmask_core::scene::{
    Edit, Indices, QueryError, QueryFilterData, Sets, Step, more_pairs_than, sort_row,
};
use pairmask_shaders::constants::SORTED_ROW;
use pairmask_shaders::layouts::SceneMode;

use super::memory::RECORD_BYTES;
use super::plan::{MOST_SLOTS, PAIR_BYTES, Question, Room, Sizes};
use super::replica::{Names, QueriesUploaded};
use super::search::{Asked, Search};
use super::{ENGINE, Pair, search, wide};
use crate::execute::gpu::{GpuError, GpuScene};

/// Most queries of a submission: so many copies, 6 MiB, are kept where they cannot be read where they lie.
const QUERIES_TOGETHER: usize = 1 << 18;

/// More queries than one in so many boxes are never entries: too many boxes have one of them near.
const ENTRIES_SHARE: u64 = 32;

impl GpuScene {
    /// The boxes that each of `queries` overlaps and may meet by its filter data, enabled, static ones too: pairs of the
    /// query's number and the box's index, in order. What `found` held is dropped. Returns how many boxes were tested.
    /// No later edit reports anything else for it.
    ///
    /// # Errors
    /// [`QueryError`]; `found` is empty then. After [`CullError::DeviceLost`] the scene is to be dropped. Where
    /// memory is short, there are more pairs than [may be](Self::limit_query_pairs), or queries crowd one place too
    /// much, the scene is what it was.
    pub fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
        found: &mut Vec<[u32; 2]>,
    ) -> Result<u64, QueryError> {
        filter_data.check(queries.len())?;
        let tested = self.query_all(queries, found)?;
        let states = &self.roster.states;
        filter_data.filter(&states.filters, |index| states.has(index, STILL), found);
        Ok(tested)
    }

    fn query_all(&mut self, queries: &[Aabb], found: &mut Vec<Pair>) -> Result<u64, CullError> {
        found.clear();
        self.submissions = 0;
        if self.roster.states.active() == 0 {
            return Ok(0);
        }
        let mut tested = 0;
        let are_entries = !self.was_asked && self.may_be_entries(queries.len() as u64);
        self.was_asked = true;
        for (part, queries) in queries.chunks(QUERIES_TOGETHER).enumerate() {
            self.check_wanted()?;
            let first = part * QUERIES_TOGETHER;
            let before = found.len();
            loop {
                let answered = self.query_together(queries, first as u32, are_entries, found);
                self.replicas.end_edit();
                match answered {
                    Ok(more) => {
                        tested += more;
                        break;
                    }
                    // Another GPU has all that this one had, but for a grid that stood.
                    Err(CullError::DeviceLost { .. }) if self.replicas.leave_first() => {
                        self.standing = None;
                        found.truncate(before);
                    }
                    Err(error) => {
                        // Blocks that they use may have been replaced before it failed.
                        self.replicas.first().frames.clear();
                        self.standing = None;
                        found.clear();
                        return Err(error);
                    }
                }
            }
        }
        Ok(tested)
    }

    /// Most pairs that later queries may find; 2^32 − 1 unless set.
    pub fn limit_query_pairs(&mut self, most: u64) {
        self.most_query_pairs = most.min(u64::from(u32::MAX));
    }

    /// Whether so many queries may lie behind the scene's records, and few boxes look at them.
    fn may_be_entries(&mut self, queries: u64) -> bool {
        let most = (self.replicas.first().tools.binding_bytes / RECORD_BYTES).min(MOST_SLOTS);
        queries <= QUERIES_TOGETHER as u64
            && queries * ENTRIES_SHARE <= self.roster.states.active() as u64
            && self.roster.states.index_end() as u64 + queries <= most
    }

    /// Queries of one submission, numbered from `first` on; their pairs go behind those found.
    fn query_together(
        &mut self,
        queries: &[Aabb],
        first: u32,
        are_entries: bool,
        found: &mut Vec<Pair>,
    ) -> Result<u64, CullError> {
        let threads = self.threads();
        let (slots, count) = (self.roster.states.index_end() as u64, queries.len() as u64);
        let active = self.roster.states.active() as u64;
        let set = [Step::Set(Sets {
            indices: Indices::Range { first: slots as u32, count: count as u32 },
            boxes: queries,
        })];
        let (question, steps, apart) = if are_entries {
            let (slots, active) = (slots + count, active + count);
            let question = Question { mode: SceneMode::Query, slots, active, changed: count };
            (question, set.as_slice(), [].as_slice())
        } else {
            let question = Question { mode: SceneMode::All, slots, active, changed: active };
            (question, [].as_slice(), queries)
        };
        let sets = self.gathered.sets(Edit { steps });
        let replica = self.replicas.first();
        let gpu = Arc::clone(replica.tools.gpu());
        let gpu_error = |error: GpuError| gpu.cull_error(ENGINE, &error);
        let uploaded = replica.put(sets, &[], apart, question.slots, Names::Kept, threads);
        let QueriesUploaded { queries: apart, mut replaced } = uploaded.map_err(gpu_error)?;
        if are_entries {
            self.layouts.note_queries(&question, queries);
        }
        let binding_bytes = replica.tools.binding_bytes;
        let mut room = Room { pairs: self.query_pairs, ..self.rooms[question.mode as usize] };
        room = Room::expected(&question, room).within(binding_bytes);
        loop {
            // Until the queries have their answer: an error leaves nothing to rely on.
            let standing = self.standing.take();
            let layout = standing.unwrap_or_else(|| self.layouts.layout(&question));
            let builds = std::mem::take(&mut replaced) || standing.is_none();
            let count = count as u32;
            let search = apart.as_ref().map_or(Search::Entries(count), |boxes| Search::Grid {
                count,
                boxes,
                builds,
            });
            let asked = Asked {
                question,
                search,
                layout,
                sizes: Sizes::of(&question, &layout, count.into()),
                room,
                epoch: self.epoch,
                naming: 0,
                // Each time: the last submission has emptied their records.
                applies: are_entries,
            };
            let replica = self.replicas.first();
            let made = replica.submit(&asked).map_err(gpu_error)?;
            let summary = replica.wait(&asked).map_err(gpu_error)?;
            self.submissions += 1;
            self.note_stages()?;
            let (pairs, tested) = (wide(summary.found), wide(summary.tested));
            if u64::from(summary.entries) > made.entries {
                room.entries = u64::from(summary.entries);
                continue;
            }
            // What looks are all boxes, or the queries, and all that those find is worth a test.
            let all = u64::from(summary.entries) + u64::from(summary.rows);
            let looked = if are_entries { all } else { u64::from(count) + pairs };
            let is_bad = self.layouts.note_search(&question, &summary, looked, tested);
            if summary.tested[1] >= search::BUDGET {
                return Err(CullError::TooCrowded { engine: ENGINE });
            }
            self.standing = (!are_entries).then_some(layout);
            if (found.len() as u64).saturating_add(pairs) > self.most_query_pairs {
                return Err(more_pairs_than(self.most_query_pairs));
            }
            if pairs > made.pairs {
                let needed_bytes = pairs.saturating_mul(PAIR_BYTES);
                if needed_bytes > binding_bytes {
                    return Err(ReserveError::OutOfMemory { needed_bytes }.into());
                }
                room.pairs = pairs;
                continue;
            }
            if is_bad && self.standing.is_some() && !self.is_second_grid {
                // The next queries have another one, and keep it: crowded boxes are so in any.
                self.standing = None;
                self.is_second_grid = true;
            }
            self.rooms[question.mode as usize].entries = u64::from(summary.entries);
            self.query_pairs = pairs;
            self.append(pairs as usize, first, found)?;
            return Ok(tested);
        }
    }

    fn append(&mut self, count: usize, first: u32, found: &mut Vec<Pair>) -> Result<(), CullError> {
        let needed_bytes = (count * size_of::<Pair>()) as u64;
        let no_memory = |_| CullError::Reserve(ReserveError::OutOfMemory { needed_bytes });
        let before = found.len();
        found.try_reserve(count).map_err(no_memory)?;
        found.resize(before + count, [0; 2]);
        let found = &mut found[before..];
        let first_replica = self.replicas.first();
        let lost = || first_replica.tools.gpu.cull_error(ENGINE, &GpuError::Lost);
        first_replica.blocks.as_ref().ok_or_else(lost)?.found.block.read(0, found);
        sort_long_rows(found);
        if first > 0 {
            for pair in found.iter_mut() {
                pair[0] += first;
            }
        }
        Ok(())
    }
}

/// Sorts the rows of pairs by query that the GPU has left: those of more than [`SORTED_ROW`] pairs.
fn sort_long_rows(found: &mut [Pair]) {
    // A long row has two pairs that are so far apart, one of them at a multiple of that.
    let step = SORTED_ROW as usize / 2;
    let mut at = 0;
    while at + step < found.len() {
        let query = found[at][0];
        if found[at + step][0] != query {
            at += step;
            continue;
        }
        let start = found[..at].partition_point(|pair| pair[0] < query);
        let end = at + found[at..].partition_point(|pair| pair[0] <= query);
        if end - start > SORTED_ROW as usize {
            sort_row(&mut found[start..end]);
        }
        at = end.next_multiple_of(step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Random;

    #[test]
    fn rows_that_the_gpu_leaves_are_sorted() {
        let mut random = Random::new(9);
        let mut next = |bound: u32| random.below(bound.into()) as u32;
        for round in 0..200 {
            let mut found = Vec::new();
            for query in 0..next(20) {
                let most = if round % 2 == 0 { 700 } else { 2 * SORTED_ROW };
                let mut row: Vec<Pair> = (0..next(most)).map(|index| [query, index]).collect();
                if row.len() > SORTED_ROW as usize {
                    for at in (1..row.len()).rev() {
                        row.swap(at, next(at as u32 + 1) as usize);
                    }
                }
                found.append(&mut row);
            }
            sort_long_rows(&mut found);
            assert!(found.is_sorted(), "round {round}");
        }
    }
}
