//! Rows of a range against all columns after them, the columns of a 64-bit mask word at a time.

use std::ops::Range;

use super::words::WordList;
use crate::aabb::KeyBox;
use crate::engine::ingest::{ColumnWords, WORD_COLUMNS};
use crate::simd::per_isa;

per_isa! {
    /// Finds the words of a range of rows of `n` boxes. Returns the number of pairs whose keys were
    /// compared.
    pub(super) fn find<simd: S>(
        columns: &ColumnWords<'_>,
        n: usize,
        rows: Range<usize>,
        found: &mut WordList,
    ) -> u64 {
        let words = columns[0].len();
        let mut compared = 0;
        for row in rows {
            let key = key_box(columns, row);
            if key == KeyBox::NOTHING {
                continue;
            }
            compared += (n - 1 - row) as u64;
            let first = row / WORD_COLUMNS;
            found.make_room(words - first);
            let [min, max] = [key.min, key.max];
            let mut of_row = [[simd.splat(0); 2]; 3];
            for axis in 0..3 {
                of_row[axis] = [simd.splat(min[axis]), simd.splat(max[axis])];
            }
            // Bits of the columns after the row.
            let mut requested = (u64::MAX << (row % WORD_COLUMNS)) << 1;
            for word in first..words {
                let mut bits = 0;
                for at in (0..WORD_COLUMNS).step_by(S::LANES) {
                    let mut met = simd.all_meet();
                    for axis in 0..3 {
                        let min = simd.load(&columns[axis][word][at..]);
                        let max = simd.load(&columns[3 + axis][word][at..]);
                        met = simd.meet(met, [min, max], of_row[axis]);
                    }
                    bits |= u64::from(simd.met_bits(met)) << at;
                }
                found.push(row as u32, word as u32, bits & requested);
                requested = u64::MAX;
            }
        }
        compared
    }
}

#[inline(always)]
fn key_box(columns: &ColumnWords<'_>, index: usize) -> KeyBox {
    let (word, lane) = (index / WORD_COLUMNS, index % WORD_COLUMNS);
    let key = |component: usize| columns[component][word][lane];
    KeyBox { min: [key(0), key(1), key(2)], max: [key(3), key(4), key(5)] }
}
