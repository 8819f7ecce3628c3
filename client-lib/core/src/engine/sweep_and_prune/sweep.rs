//! One task's rows against the window after each.

use std::ops::Range;

use crate::engine::AvailableIsa;
use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, STRIP_COLUMNS, StripTask};
use crate::simd::per_isa;

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
    // The first row of a stretch of 16, those of its rows whose windows are not searched yet, and the next column of the
    // first of these; 0 before its first.
    let mut stretch = task.rows.start;
    let mut windowed = windowed_rows(mins, maxs, &task.rows, stretch, gather.isa);
    let mut start = 0;
    while stretch < task.rows.end {
        if task.batch.room() == 0 {
            task.flush(boxes, gather);
            if gather.budget.is_spent() {
                return;
            }
        }
        let rows = &task.rows;
        task.batch.push_all(|slots| {
            while stretch < rows.end {
                while windowed != 0 {
                    let row = stretch + windowed.trailing_zeros();
                    let max = maxs[row as usize];
                    start = start.max(row + 1);
                    // The window ends at the first box that starts after this one ends. It is looked for
                    // a strip at a time, and the test of the strip finds the place within.
                    while start < valid && mins[start as usize] <= max {
                        if slots.room() == 0 {
                            return;
                        }
                        let strip_end = valid.min(start + STRIP_COLUMNS as u32);
                        start = slots.push(row, start, strip_end);
                    }
                    windowed &= windowed - 1;
                    start = 0;
                }
                stretch += STRIP_COLUMNS as u32;
                windowed = windowed_rows(mins, maxs, rows, stretch, gather.isa);
            }
        });
    }
    task.finish(boxes, gather);
}

/// Bit i: row `first + i` is one of the rows, and the box after it starts before it ends.
#[inline]
fn windowed_rows(
    mins: &[i32],
    maxs: &[i32],
    rows: &Range<u32>,
    first: u32,
    isa: AvailableIsa,
) -> u32 {
    if first >= rows.end {
        return 0;
    }
    let all = windowed(&mins[first as usize + 1..], &maxs[first as usize..], isa);
    let left = (rows.end - first).min(STRIP_COLUMNS as u32);
    all & ((1 << left) - 1)
}

per_isa! {
    /// Bit i: min i is no greater than max i, for [`STRIP_COLUMNS`] of them.
    fn windowed<simd: S>(mins: &[i32], maxs: &[i32]) -> u32 {
        let mut all = 0;
        for first in (0..STRIP_COLUMNS).step_by(S::LANES) {
            let (min, max) = (simd.load(&mins[first..]), simd.load(&maxs[first..]));
            all |= (!simd.bits(simd.above(min, max)) & (u32::MAX >> (32 - S::LANES))) << first;
        }
        all
    }
}
