//! One task's rows against the window after each.

use std::ops::Range;

use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, STRIP_COLUMNS, StripBatch, WordSink};

/// A range of positions and what was found in its rows. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct SweepTask {
    pub rows: Range<u32>,
    pub found: WordSink,
    pub compared: u64,
    batch: StripBatch,
}

impl SweepTask {
    pub fn allocated_bytes(&self) -> usize {
        self.found.allocated_bytes() + self.batch.allocated_bytes()
    }

    /// Finds the words of all rows, until the budget is spent. Boxes from position `solid` on overlap
    /// nothing.
    pub fn run(&mut self, boxes: &OrderedBoxes, gather: &Gather<'_>, axis: usize, solid: u32) {
        self.found.clear();
        self.batch.reset();
        let keys = boxes.keys();
        let (mins, maxs) = (keys[axis], keys[3 + axis]);
        let mut row = self.rows.start;
        let mut start = row + 1;
        while row < self.rows.end {
            if self.batch.room() == 0 {
                self.flush(boxes, gather);
                if gather.budget.is_spent() {
                    return;
                }
            }
            let end = self.rows.end;
            self.batch.push_all(|places| {
                while row < end {
                    let max = maxs[row as usize];
                    // The window ends at the first box that starts after this one ends. It is looked for
                    // a strip at a time, and the test of the strip finds the place within.
                    while start < solid && mins[start as usize] <= max {
                        if places.room() == 0 {
                            return;
                        }
                        let strip_end = solid.min(start + STRIP_COLUMNS as u32);
                        start = places.push(row, start, strip_end);
                    }
                    row += 1;
                    start = row + 1;
                }
            });
        }
        self.flush(boxes, gather);
        self.found.finish(gather);
        self.compared = self.batch.take_compared();
    }

    fn flush(&mut self, boxes: &OrderedBoxes, gather: &Gather<'_>) {
        self.batch.test(boxes, gather.isa);
        self.found.take(&self.batch, gather);
        self.batch.clear();
    }
}
