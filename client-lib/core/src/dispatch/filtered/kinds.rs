//! The kinds of a frame's boxes, and which of them meet.

use crate::filters::{FilterData, FilterId, Rules};
use crate::team::{for_each_in_parts, in_parts, part_count};

/// Kinds up to which each block of columns has a word a kind: those of its columns that the kind meets.
/// Memory is as much as a bit a box and kind.
pub const MOST_KINDS: usize = 32;

/// Boxes of a task that looks for their kinds, at least: some 10 µs.
const TASK_BOXES: usize = 8_192;

/// The kinds of a frame's boxes: a filter, and whether the box is static.
pub struct Kinds(Vec<(FilterId, bool)>);

impl Kinds {
    /// The kinds of `count` entries of filter data, and that of each entry of filter data. `None` where there are more than `most`, 256 at
    /// the most.
    pub fn of(
        rules: &Rules,
        count: usize,
        filter_data: impl Fn(u32) -> FilterData + Sync,
        most: usize,
        kind_of: &mut Vec<u8>,
        threads: usize,
    ) -> Option<Self> {
        // Filters that are not in the table are one more kind: all of them meet everything.
        let beyond = rules.table.filters().len();
        let slot = |filter_data: FilterData| {
            2 * usize::from(filter_data.filter.0).min(beyond) + usize::from(filter_data.is_static())
        };
        let parts = part_count(count, TASK_BOXES, threads);
        kind_of.resize(count, 0);
        let step = count.div_ceil(parts).max(1);
        let mut work: Vec<(u32, &mut [u8])> =
            (0..).step_by(step).zip(kind_of.chunks_mut(step)).collect();

        let look = |work: &mut [(u32, &mut [u8])]| {
            let mut seen = vec![false; 2 * (beyond + 1)];
            for (first, kinds) in work {
                (*first..)
                    .zip(&**kinds)
                    .for_each(|(index, _)| seen[slot(filter_data(index))] = true);
            }
            seen
        };
        let join = |mut all: Vec<bool>, more: Vec<bool>| {
            all.iter_mut().zip(more).for_each(|(seen, more)| *seen |= more);
            all
        };
        let seen = in_parts(work.as_mut_slice(), parts, &look, &join);
        let slots: Vec<usize> = (0..seen.len()).filter(|slot| seen[*slot]).collect();
        if slots.len() > most {
            return None;
        }
        let mut kinds = vec![0; seen.len()];
        for (kind, slot) in slots.iter().enumerate() {
            kinds[*slot] = kind as u8;
        }
        for_each_in_parts(&mut work, parts, |(first, of)| {
            (*first..).zip(&mut **of).for_each(|(index, of)| *of = kinds[slot(filter_data(index))]);
        });
        let kind = |slot: &usize| (FilterId((slot / 2) as u16), slot % 2 == 1);
        Some(Self(slots.iter().map(kind).collect()))
    }

    /// For each kind, `words` words with a bit for each that it meets.
    pub fn meets(&self, rules: &Rules, words: usize) -> Vec<u32> {
        let is_static = |(id, of_box): (FilterId, bool)| of_box || rules.table.get(id).is_static;
        let meet = |a: (FilterId, bool), b: (FilterId, bool)| {
            rules.table.meet(a.0, b.0) && !(is_static(a) && is_static(b))
        };
        let mut rows = vec![0; words * self.0.len()];
        for (a, row) in self.0.iter().zip(rows.chunks_mut(words)) {
            for (bit, b) in self.0.iter().enumerate() {
                if let Some(word) = row.get_mut(bit / 32) {
                    *word |= u32::from(meet(*a, *b)) << (bit % 32);
                }
            }
        }
        rows
    }
}
