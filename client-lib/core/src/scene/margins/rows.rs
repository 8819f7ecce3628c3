//! Near pairs by box, and the state of each.
//!
//! Each pair lies in the rows of both of its boxes, four bytes in each: the index of the other box, and the
//! state in the bits above. Rows are sorted, so that a pair is found in log(its neighbours), and lists that
//! are read row by row are sorted.

use super::super::options::MOST_BOXES;
use super::super::pair_list::Pair;
use crate::fetch::ask_for;

/// State of a pair, in the bits above the index.
pub(super) mod state {
    use super::MOST_BOXES;

    /// It is near: a pair of the boxes that were sent.
    pub const NEAR: u32 = MOST_BOXES;
    pub const IS: u32 = MOST_BOXES << 1;
    /// It was reported: it was a pair at the last taken answer.
    pub const WAS: u32 = MOST_BOXES << 2;
}
use state::{IS, NEAR, WAS};

const INDEX: u32 = MOST_BOXES - 1;
const _: () = assert!(MOST_BOXES.is_power_of_two() && WAS.leading_zeros() == 0);

/// Rows with more room than this are made smaller when they have become short.
const ROOM_KEPT: usize = 64;

/// The pairs of each index.
#[derive(Debug, Default)]
pub(super) struct Rows {
    links: Vec<Vec<u32>>,
    /// Rows that are no longer in order; some more than once.
    unsorted: Vec<u32>,
    /// Rows with pairs that are neither near nor were reported; some more than once.
    dead: Vec<u32>,
}

impl Rows {
    /// Makes room for indices below `n`.
    pub fn grow(&mut self, n: usize) {
        self.links.resize_with(n.max(self.links.len()), Vec::new);
    }

    pub const fn len(&self) -> usize {
        self.links.len()
    }

    /// Bytes that are allocated, but for what the allocator adds.
    pub fn allocated_bytes(&self) -> usize {
        let links: usize = self.links.iter().map(Vec::capacity).sum();
        self.links.capacity() * size_of::<Vec<u32>>() + links * size_of::<u32>()
    }

    #[inline]
    fn position(&self, row: u32, other: u32) -> Option<usize> {
        self.links[row as usize].binary_search_by_key(&other, |link| link & INDEX).ok()
    }

    /// The state of a pair; 0 where the rows do not have it. Rows are in order.
    #[inline]
    pub fn state(&self, [a, b]: Pair) -> u32 {
        self.position(a, b).map_or(0, |at| self.links[a as usize][at] & !INDEX)
    }

    /// Sets the state of a pair to what `to` makes of it; the state that it had, if the rows have it. Rows are in
    /// order.
    #[inline]
    pub fn update(&mut self, [a, b]: Pair, to: impl FnOnce(u32) -> u32) -> Option<u32> {
        let at = self.position(a, b)?;
        let link = &mut self.links[a as usize][at];
        let before = *link & !INDEX;
        let state = to(before);
        if state == before {
            return Some(before);
        }
        *link = b | state;
        if let Some(at) = self.position(b, a) {
            self.links[b as usize][at] = a | state;
        }
        if state & (NEAR | WAS) == 0 {
            self.dead.extend([a, b]);
        }
        Some(before)
    }

    /// Adds a pair that there is not; [`tidy`](Self::tidy) is to follow.
    pub fn add(&mut self, [a, b]: Pair, state: u32) {
        for (row, other) in [(a, b), (b, a)] {
            let links = &mut self.links[row as usize];
            if links.last().is_some_and(|last| last & INDEX > other) {
                self.unsorted.push(row);
            }
            links.push(other | state);
        }
    }

    /// Brings rows in order, and takes out pairs that are neither near nor were reported. A row is read through
    /// once, however many of its pairs have changed.
    pub fn tidy(&mut self) {
        let Self { links, unsorted, dead } = self;
        for list in [&mut *unsorted, &mut *dead] {
            list.sort_unstable();
            list.dedup();
        }
        for row in unsorted.drain(..) {
            // What was added is in order, and so is what was there: two runs, which a stable sort merges.
            links[row as usize].sort_by_key(|link| link & INDEX);
        }
        for row in dead.drain(..) {
            drop_dead(&mut links[row as usize]);
        }
    }

    #[inline]
    pub fn ask_for(&self, index: u32) {
        ask_for(&self.links[index as usize], 0);
    }

    /// The other box and the state of each pair of an index.
    #[inline]
    pub fn of(&self, index: u32) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.links[index as usize].iter().map(|link| (link & INDEX, link & !INDEX))
    }

    /// All pairs and their states, in order.
    pub fn iter(&self) -> impl Iterator<Item = (Pair, u32)> + '_ {
        self.links.iter().zip(0u32..).flat_map(|(row, a)| {
            let first = row.partition_point(|link| link & INDEX <= a);
            row[first..].iter().map(move |link| ([a, link & INDEX], link & !INDEX))
        })
    }

    /// Sets the state of every pair to what `to` makes of it, and takes out those that are neither near nor
    /// were reported.
    pub fn set_all(&mut self, to: impl Fn(u32) -> u32) {
        for row in &mut self.links {
            for link in row.iter_mut() {
                *link = *link & INDEX | to(*link & !INDEX);
            }
            drop_dead(row);
        }
    }
}

fn drop_dead(row: &mut Vec<u32>) {
    row.retain(|link| link & (NEAR | WAS) != 0);
    if row.capacity() > ROOM_KEPT && row.len() < row.capacity() / 4 {
        row.shrink_to(row.len() * 2);
    }
}

/// Whether the boxes of a pair overlap, by its state.
#[inline]
pub(super) const fn is_pair(state: u32) -> bool {
    state & IS != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_was_long_gives_its_memory_back() {
        let mut rows = Rows::default();
        rows.grow(2_000);
        (1..2_000).for_each(|other| rows.add([0, other], NEAR));
        let full = rows.allocated_bytes();
        rows.tidy();
        for other in 1..2_000 {
            rows.update([0, other], |_| 0);
        }
        rows.tidy();
        assert!(rows.allocated_bytes() + 4 * 1_900 < full);
        assert_eq!(rows.iter().count(), 0);
    }
}
