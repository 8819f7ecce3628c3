//! What one thread searches with.

use std::ops::Range;

use super::{OrderedBoxes, RowBlock, StripBatch, WordSink};
use crate::engine::gather::Gather;

/// A range of rows, and what was found in them. Memory is kept from frame to frame. `Own` is what an engine's
/// search needs beside it.
#[derive(Default)]
pub(crate) struct StripTask<Own = ()> {
    pub rows: Range<u32>,
    pub found: WordSink,
    pub batch: StripBatch,
    pub block: RowBlock,
    /// Columns compared.
    pub compared: u64,
    pub own: Own,
}

impl<Own> StripTask<Own> {
    /// Drops what was found, and what a frame that was refused left behind.
    pub fn begin(&mut self) {
        self.found.clear();
        self.batch.clear();
        self.compared = 0;
    }

    /// Tests the strips of the batch.
    #[inline(never)]
    pub fn flush(&mut self, boxes: &OrderedBoxes, gather: &Gather<'_>) {
        if self.batch.is_empty() {
            return;
        }
        self.compared += self.batch.test(boxes, gather.isa);
        self.found.take(&self.batch, gather);
        self.batch.clear();
    }

    /// Tests the block, after the batch: words come in the order of rows.
    pub fn flush_block(&mut self, boxes: &OrderedBoxes, gather: &Gather<'_>) {
        self.flush(boxes, gather);
        let tested = self.block.test(boxes, gather.isa);
        self.compared += tested;
        let before = self.found.pair_count();
        self.found.take_block(&self.block, gather);
        let pairs = self.found.pair_count().saturating_sub(before);
        self.found.note_tests(tested, pairs, gather);
    }

    /// Ends the words of all rows.
    pub fn finish(&mut self, boxes: &OrderedBoxes, gather: &Gather<'_>) {
        self.flush(boxes, gather);
        self.found.finish(gather);
    }

    pub fn allocated_bytes(&self) -> usize {
        self.found.allocated_bytes() + self.batch.allocated_bytes()
    }
}
