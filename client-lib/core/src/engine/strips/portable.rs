//! Strips in plain Rust: for machines without a kernel of their own, and the yardstick of those.

use super::STRIP_COLUMNS;
use super::batch::{check_bounds, count_columns};
use super::ordered::KeyArrays;

/// Tests every strip; see [`super::StripBatch::test`]. Returns the columns compared.
pub(super) fn test(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &mut [u16]) -> u64 {
    check_bounds(keys, rows, starts, lanes);
    let compared = count_columns(lanes);
    for ((&row, &start), lanes) in rows.iter().zip(starts).zip(lanes) {
        let columns = keys.map(|k| &k[start as usize..][..STRIP_COLUMNS]);
        let row: [i32; 6] = keys.map(|k| k[row as usize]);
        let mut bits = 0u16;
        for t in 0..STRIP_COLUMNS {
            let overlap = (0..3).fold(true, |all, axis| {
                all & (columns[axis][t] <= row[3 + axis]) & (row[axis] <= columns[3 + axis][t])
            });
            bits |= u16::from(overlap) << t;
        }
        *lanes &= bits;
    }
    compared
}
