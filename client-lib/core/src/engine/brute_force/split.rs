//! Rows shared out among threads: contiguous ranges of about as many pairs each.

/// Fewest boxes that are worth a second thread: below, waking it costs more than it saves.
const PARALLEL_BOXES: usize = 512;

/// Tasks per thread of the pool, so that a thread that is held up does not hold up the frame.
const TASKS_PER_THREAD: usize = 4;

/// Tasks of a frame of n boxes.
pub(crate) fn task_count(n: usize, threads: usize) -> usize {
    if threads <= 1 || n < PARALLEL_BOXES {
        return 1;
    }
    threads * TASKS_PER_THREAD
}

/// First row of part `part` of `parts`, of n rows; part `parts` starts at n.
///
/// Row i has n − 1 − i pairs, so that rows below x hold the share 1 − (1 − x/n)² of them. Rounding
/// moves borders by a row and never a pair: which thread finds a pair does not change the mask.
pub(crate) fn first_row(part: usize, parts: usize, n: usize) -> usize {
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
