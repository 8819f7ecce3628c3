//! One task's rows against the window after each.

use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, STRIP_COLUMNS, StripTask};

/// Finds the words of all rows, until the budget is spent. Boxes from position `valid` on overlap
/// nothing.
pub(super) fn search(
    task: &mut StripTask,
    boxes: &OrderedBoxes,
    axis: usize,
    valid: u32,
    gather: &Gather<'_>,
) {
    task.begin();
    let keys = boxes.keys();
    let (mins, maxs) = (keys[axis], keys[3 + axis]);
    let mut row = task.rows.start;
    let mut start = row + 1;
    while row < task.rows.end {
        if task.batch.room() == 0 {
            task.flush(boxes, gather);
            if gather.budget.is_spent() {
                return;
            }
        }
        let end = task.rows.end;
        task.batch.push_all(|slots| {
            while row < end {
                let max = maxs[row as usize];
                // The window ends at the first box that starts after this one ends. It is looked for
                // a strip at a time, and the test of the strip finds the place within.
                while start < valid && mins[start as usize] <= max {
                    if slots.room() == 0 {
                        return;
                    }
                    let strip_end = valid.min(start + STRIP_COLUMNS as u32);
                    start = slots.push(row, start, strip_end);
                }
                row += 1;
                start = row + 1;
            }
        });
    }
    task.finish(boxes, gather);
}
