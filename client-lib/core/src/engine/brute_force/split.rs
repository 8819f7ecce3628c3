//! Rows shared out among threads: contiguous ranges of about as many pairs each.

use std::ops::Range;

use crate::team::part_count;

/// Fewest boxes that are worth a second thread: below, waking it costs more than it saves.
const PARALLEL_BOXES: usize = 512;

/// Threads of a frame of n boxes.
pub(crate) const fn threads_for(n: usize, threads: usize) -> usize {
    if n < PARALLEL_BOXES { 1 } else { threads }
}

/// Ranges of the rows of n boxes, for the tasks of so many threads.
pub(crate) fn ranges(n: usize, threads: usize) -> impl ExactSizeIterator<Item = Range<usize>> {
    let parts = part_count(n, 1, threads);
    (0..parts).map(move |part| first_row(part, parts, n)..first_row(part + 1, parts, n))
}

/// First row of part `part` of `parts`, of n rows; part `parts` starts at n.
///
/// Row i has n − 1 − i pairs, so that rows below x hold the share 1 − (1 − x/n)² of them. Rounding
/// moves borders by a row and never a pair: which thread finds a pair does not change the mask.
fn first_row(part: usize, parts: usize, n: usize) -> usize {
    if part >= parts {
        return n;
    }
    let share = part as f64 / parts as f64;
    ((n as f64 * (1.0 - (1.0 - share).sqrt())) as usize).min(n)
}

#[cfg(test)]
mod tests {
    use super::first_row;

    #[test]
    fn parts_cover_all_rows_in_order_and_share_the_pairs() {
        for n in [0, 1, 2, 3, 70, 1234, 100_000] {
            for parts in [1, 2, 3, 8, 64] {
                let borders: Vec<_> = (0..=parts).map(|p| first_row(p, parts, n)).collect();
                assert_eq!((borders[0], borders[parts]), (0, n));
                assert!(borders.is_sorted());
            }
        }
        let (n, half) = (10_000f64, first_row(1, 2, 10_000) as f64);
        let share = half * (2.0 * n - half) / (n * n);
        assert!((share - 0.5).abs() < 1e-3, "{share}");
    }
}
