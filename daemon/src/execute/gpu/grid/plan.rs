//! Sizes of a frame's buffers and dispatches. Pure: functions of the number of boxes, of what is to be
//! found and of the room in the reply.

use pairmask_core::BoxCount;
use pairmask_core::mask::{MaskShape, SECTION_ALIGN_WORDS, Span};
use pairmask_shaders::Found;
use pairmask_shaders::constants::{
    BATCH_BOXES, CONTROL_HEADER_WORDS, GRID_LEVELS, SCAN_CELLS, SUPER_BATCHES, SUPERS_MOST,
};
use pairmask_shaders::layouts::GridParams;

use super::layout::cells_most;

/// Most boxes: batches are one dimension of a dispatch, and a slot has `LEVEL_SHIFT` bits.
pub const MAX_BOXES: u64 = 65_535 * BATCH_BOXES as u64;

/// Rounds of a row's walk that are no tests, at the most: a level has 9 lines of cells around a row, which take 13
/// rounds, and the workgroup has a few loops of its own.
const OTHER_ROUNDS: u32 = 16 * GRID_LEVELS;

/// Most work in crowded cells, and of giants, in 2^20 tests: 17 thousand million tests take an H200
/// tens of milliseconds. More is left to the all-pairs engine, which does such scenes faster.
const BUDGET: u32 = 1 << 14;

/// Items for each box that a reply has room for; a scene that had more last time gets more.
const ENTRIES_A_BOX: u64 = 2;

/// Words of a pair in a list.
const PAIR_WORDS: u64 = 2;

/// Words of a mask word with its row and block.
const SPARSE_WORDS: u64 = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    pub n: u32,
    pub batches: u32,
    pub supers: u32,
    pub sums: u32,
}

impl Sizes {
    /// Of a frame of `n` boxes, at most 65,535 batches of them.
    pub const fn of(n: BoxCount) -> Self {
        let n = n.get();
        let batches = n.div_ceil(BATCH_BOXES);
        // The entry after the last cell holds n.
        let sums = (cells_most(n) + 1).div_ceil(SCAN_CELLS as u64) as u32;
        Self { n, batches, supers: batches.div_ceil(SUPER_BATCHES), sums }
    }

    pub const fn plane(&self) -> u32 {
        self.batches * BATCH_BOXES
    }

    pub const fn table_bytes(&self) -> u64 {
        4 * self.sums as u64 * SCAN_CELLS as u64
    }

    pub const fn control_bytes(&self) -> u64 {
        4 * (CONTROL_HEADER_WORDS as u64 + SUPERS_MOST as u64 + self.sums as u64)
    }

    /// Bytes of the records, and as many of the sorted boxes: 32 a box.
    pub const fn records_bytes(&self) -> u64 {
        32 * self.plane() as u64
    }

    /// Words of the order at the start of a sparse reply, rounded up.
    pub const fn order_words(&self) -> u64 {
        (self.n as u64).next_multiple_of(SECTION_ALIGN_WORDS)
    }

    pub const fn reply_words(&self, capacity: Capacity) -> u64 {
        let Capacity { found, entries } = capacity;
        match found {
            Found::Words => {
                self.order_words() + SPARSE_WORDS * entries.next_multiple_of(SECTION_ALIGN_WORDS)
            }
            Found::Pairs => PAIR_WORDS * entries,
        }
    }

    /// Where a mask of `entries` words or pairs lies: a function of the scene, regardless of the room that there was.
    pub const fn shape(&self, found: Found, entries: u64) -> MaskShape {
        let stride = entries.next_multiple_of(SECTION_ALIGN_WORDS);
        let rows = self.order_words();
        match found {
            Found::Words => MaskShape::Sparse {
                rows: Span { start: rows, len: entries },
                blocks: Span { start: rows + stride, len: entries },
                bits: Span { start: rows + 2 * stride, len: entries },
                order: Some(Span { start: 0, len: self.n as u64 }),
            },
            Found::Pairs => MaskShape::list(entries),
        }
    }

    /// What every stage reads, for a thread that may go through its loops `thread_rounds` times. The capacity's
    /// reply fits a binding.
    pub const fn params(&self, capacity: Capacity, thread_rounds: u32) -> GridParams {
        GridParams {
            n: self.n,
            plane: self.plane(),
            batch_count: self.batches,
            super_count: self.supers,
            sum_count: self.sums,
            capacity: capacity.entries as u32,
            order_words: self.order_words() as u32,
            budget: BUDGET,
            // A row is walked twice where its batch finds more words than the workgroup keeps.
            row_tests: thread_rounds / 2 - OTHER_ROUNDS,
        }
    }
}

pub const fn is_over_budget(work: u32, giant_work: u32) -> bool {
    work > BUDGET || giant_work > BUDGET
}

/// Most boxes whose buffers fit one binding of so many bytes.
pub const fn max_boxes(binding_bytes: u64) -> u64 {
    // Records take 32 bytes a box; the table 4 a cell, and there are some six cells a box.
    let records = binding_bytes / 32 / BATCH_BOXES as u64 * BATCH_BOXES as u64;
    let most = if records < MAX_BOXES { records } else { MAX_BOXES };
    if most > u32::MAX as u64 { u32::MAX as u64 } else { most }
}

/// What a frame finds, and how much of it the reply and the block of found items have room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    pub found: Found,
    /// Mask words, or pairs. At least 1: an empty block cannot be bound.
    pub entries: u64,
}

impl Capacity {
    /// Two items a box, or a quarter more than the last frame had; `room` at the most.
    pub fn expected(n: BoxCount, found: Found, last_entries: u64, room: u64) -> Self {
        let boxes = u64::from(n.get());
        let requested = (ENTRIES_A_BOX * boxes).max(last_entries + last_entries / 4);
        // Whole pages' worth, so that a slowly growing scene does not record a frame anew each time.
        let rounded = requested.next_multiple_of(boxes.next_power_of_two().max(1024));
        Self { found, entries: rounded.min(most_entries(n, found)).min(room).max(1) }
    }

    pub const fn found_bytes(&self) -> u64 {
        let words = match self.found {
            Found::Words => SPARSE_WORDS,
            Found::Pairs => PAIR_WORDS,
        };
        4 * words * self.entries
    }
}

/// The most mask words, or pairs, that a scene of `n` boxes can have.
pub const fn most_entries(n: BoxCount, found: Found) -> u64 {
    match found {
        Found::Words => n.sparse_words_max(),
        Found::Pairs => n.pair_count(),
    }
}

/// The most items of `n` boxes in a reply of so many words; `None` without room for one.
pub fn room(n: BoxCount, found: Found, limit_words: u64) -> Option<u64> {
    let room = match found {
        Found::Words => {
            let arrays = limit_words.checked_sub(Sizes::of(n).order_words())?;
            arrays / SPARSE_WORDS / SECTION_ALIGN_WORDS * SECTION_ALIGN_WORDS
        }
        Found::Pairs => limit_words / PAIR_WORDS,
    };
    (room > 0).then_some(room)
}

/// What the last frames found, which the next one's reply gets room for.
#[derive(Clone, Copy, Debug, Default)]
pub struct LastFound([u64; 2]);

impl LastFound {
    pub const fn of(&self, found: Found) -> u64 {
        self.0[found as usize]
    }

    /// Notes a frame. The pairs are known regardless of what was found.
    pub const fn note(&mut self, found: Found, entries: u64, pairs: u64) {
        self.0[found as usize] = entries;
        self.0[Found::Pairs as usize] = pairs;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_hold_every_cell_and_box() {
        for n in [2, 255, 256, 257, 345, 100_000, 1_000_000, MAX_BOXES as u32] {
            let sizes = Sizes::of(BoxCount::new(n));
            assert!(sizes.plane() >= n && sizes.plane() - n < BATCH_BOXES);
            assert!(sizes.table_bytes() / 4 > cells_most(n));
            assert!(
                sizes.supers <= SUPERS_MOST
                    && sizes.supers * SUPER_BATCHES >= sizes.batches
                    && sizes.batches <= 65_535
            );
            // One thread a box zeroes the words before the scan's sums.
            assert!(CONTROL_HEADER_WORDS + sizes.supers <= sizes.plane());
        }
    }

    #[test]
    fn buffers_of_the_largest_scene_fit_a_binding() {
        for binding_bytes in [1 << 20, 128 << 20, (1u64 << 31) - 4] {
            let n = max_boxes(binding_bytes);
            let sizes = Sizes::of(BoxCount::new(n as u32));
            assert!(sizes.records_bytes() <= binding_bytes, "{n}");
            assert!(sizes.table_bytes() <= binding_bytes.max(1 << 21), "{n}");
        }
    }

    #[test]
    fn the_mask_lies_within_the_reply_that_has_room_for_it() {
        for (n, found) in [2, 17, 345].into_iter().flat_map(|n| Found::ALL.map(|f| (n, f))) {
            let (n, sizes) = (BoxCount::new(n), Sizes::of(BoxCount::new(n)));
            for entries in (0..most_entries(n, found)).step_by(13) {
                let shape = sizes.shape(found, entries);
                assert_eq!(shape.encoding(), found.encoding());
                let capacity = Capacity { found, entries };
                assert!(
                    shape.extent_words() <= sizes.reply_words(capacity),
                    "{found:?}, {entries}"
                );
                assert!(capacity.found_bytes() <= 4 * sizes.reply_words(capacity), "{found:?}");
            }
        }
    }

    #[test]
    fn the_capacity_grows_with_the_last_frame_and_never_beyond_what_is_possible() {
        for found in Found::ALL {
            let entries = |n, last| Capacity::expected(n, found, last, u64::MAX).entries;
            let n = BoxCount::new(10_000);
            assert!(entries(n, 0) >= 20_000 && entries(n, 40_000) >= 50_000);
            assert_eq!(entries(n, u64::from(u32::MAX)), most_entries(n, found));
            assert_eq!(entries(BoxCount::new(2), 0), most_entries(BoxCount::new(2), found));
            assert_eq!(Capacity::expected(n, found, 0, 7).entries, 7);
        }
    }

    #[test]
    fn a_frame_of_one_kind_leaves_the_words_of_the_other() {
        let mut last = LastFound::default();
        last.note(Found::Words, 70, 90);
        assert_eq!((last.of(Found::Words), last.of(Found::Pairs)), (70, 90));
        last.note(Found::Pairs, 20, 20);
        assert_eq!((last.of(Found::Words), last.of(Found::Pairs)), (70, 20));
    }
}
