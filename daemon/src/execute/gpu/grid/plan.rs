//! Sizes of a frame's buffers and dispatches. Pure: functions of the number of boxes and the room
//! in the reply.

use pairmask_core::BoxCount;
use pairmask_core::mask::{MaskShape, SECTION_ALIGN_WORDS, Span};
use pairmask_shaders::constants::{
    BATCH_BOXES, CONTROL_HEADER_WORDS, SCAN_CELLS, SUPER_BATCHES, SUPERS_MOST,
};
use pairmask_shaders::layouts::GridParams;

use super::layout::cells_most;

/// Most boxes: batches are numbered along one dimension of a dispatch, and a slot has
/// `LEVEL_SHIFT` bits.
pub const MAX_BOXES: u64 = 65_535 * BATCH_BOXES as u64;

/// Most work in crowded cells, and of giants, in 2^20 tests: 17 thousand million tests take an H200
/// tens of milliseconds. More is left to the all-pairs engine, which does such scenes faster.
const BUDGET: u32 = 1 << 14;

/// Words that a reply has room for before its size is known, for each box; a scene that had more
/// last time gets more.
const WORDS_A_BOX: u64 = 2;

/// Sizes that follow from the number of boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Boxes.
    pub n: u32,
    /// Batches of boxes, and of rows.
    pub batches: u32,
    /// Groups of batches.
    pub supers: u32,
    /// Workgroups of the scan.
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

    /// Boxes rounded up to whole batches.
    pub const fn plane(&self) -> u32 {
        self.batches * BATCH_BOXES
    }

    /// Bytes of the table of cells.
    pub const fn table_bytes(&self) -> u64 {
        4 * self.sums as u64 * SCAN_CELLS as u64
    }

    /// Bytes of the control block.
    pub const fn control_bytes(&self) -> u64 {
        4 * (CONTROL_HEADER_WORDS as u64 + SUPERS_MOST as u64 + self.sums as u64)
    }

    /// Bytes of the records, and as many of the sorted boxes: 32 a box.
    pub const fn records_bytes(&self) -> u64 {
        32 * self.plane() as u64
    }

    /// Words of the order at the start of the reply, rounded up.
    pub const fn order_words(&self) -> u64 {
        (self.n as u64).next_multiple_of(SECTION_ALIGN_WORDS)
    }

    /// Words of a reply with room for `capacity` mask words.
    pub const fn reply_words(&self, capacity: u64) -> u64 {
        self.order_words() + 3 * capacity.next_multiple_of(SECTION_ALIGN_WORDS)
    }

    /// Where a mask of so many words lies: a function of the scene, whatever room there was.
    pub const fn shape(&self, words: u64) -> MaskShape {
        let stride = words.next_multiple_of(SECTION_ALIGN_WORDS);
        let rows = self.order_words();
        MaskShape::Sparse {
            rows: Span { start: rows, len: words },
            blocks: Span { start: rows + stride, len: words },
            bits: Span { start: rows + 2 * stride, len: words },
            order: Some(Span { start: 0, len: self.n as u64 }),
        }
    }

    /// What every stage is told.
    pub const fn params(&self, capacity: u32) -> GridParams {
        GridParams {
            n: self.n,
            plane: self.plane(),
            batch_count: self.batches,
            super_count: self.supers,
            sum_count: self.sums,
            capacity,
            order_words: self.order_words() as u32,
            budget: BUDGET,
        }
    }
}

/// Whether a frame's work is too much for the grid.
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

/// Words that the reply gets room for: two a box, and a quarter more than `last_words`, as many as
/// the last frame had.
pub fn capacity(n: BoxCount, last_words: u64) -> u64 {
    let wanted = (WORDS_A_BOX * u64::from(n.get())).max(last_words + last_words / 4);
    // Whole pages' worth, so that a slowly growing scene does not record a frame anew each time.
    let rounded = wanted.next_multiple_of(u64::from(n.get()).next_power_of_two().max(1024));
    rounded.min(n.sparse_words_max()).max(1)
}

/// The most words of a mask of `n` boxes in a reply of so many words; `None` where there is no room for
/// a single one behind the order.
pub fn room(n: BoxCount, limit_words: u64) -> Option<u64> {
    let arrays = limit_words.checked_sub(Sizes::of(n).order_words())?;
    let room = arrays / 3 / SECTION_ALIGN_WORDS * SECTION_ALIGN_WORDS;
    (room > 0).then_some(room)
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
    fn a_reply_holds_the_words_that_there_is_room_for_and_no_more() {
        for n in [2, 15, 16, 345, 100_000] {
            let n = BoxCount::new(n);
            let sizes = Sizes::of(n);
            for limit in (sizes.reply_words(1)..).step_by(7).take(100) {
                let room = room(n, limit).expect("a word at least");
                assert!(sizes.reply_words(room) <= limit && sizes.reply_words(room + 1) > limit);
            }
            assert_eq!(room(n, sizes.reply_words(1) - 1), None);
        }
    }

    #[test]
    fn the_capacity_grows_with_the_last_frame_and_never_beyond_what_is_possible() {
        let n = BoxCount::new(10_000);
        assert!(capacity(n, 0) >= 20_000 && capacity(n, 40_000) >= 50_000);
        assert_eq!(capacity(n, u64::from(u32::MAX)), n.sparse_words_max());
        assert_eq!(capacity(BoxCount::new(2), 0), BoxCount::new(2).sparse_words_max());
    }
}
