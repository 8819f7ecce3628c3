//! One box in one SIMD register, for the comparison of single pairs.

use super::kernel::Columns;
use crate::engine::ingest::WORD_COLUMNS;

/// The keys of a box as `max x, y, z, !min x, y, z, 0, 0`.
///
/// `!` turns the order of keys round, so that both halves of the test become "not below": a column
/// overlaps a row when no lane of [`limits`] of the row is above the column's.
pub(super) type Corners = [i32; 8];

/// Corners of 64 boxes.
#[inline(always)]
pub(super) fn corners_of(columns: &Columns<'_>, out: &mut [Corners; WORD_COLUMNS]) {
    for (t, out) in out.iter_mut().enumerate() {
        let key = |component: usize| columns[component][t];
        *out = [key(3), key(4), key(5), !key(0), !key(1), !key(2), 0, 0];
    }
}

/// What the corners of a column must reach: `min x, y, z, !max x, y, z, 0, 0`.
#[inline(always)]
pub(super) fn limits(row: &Corners) -> Corners {
    [!row[3], !row[4], !row[5], !row[0], !row[1], !row[2], 0, 0]
}

/// Whether no corner misses its limit, without a branch.
#[inline(always)]
pub(super) fn reaches(limits: &Corners, column: &Corners) -> bool {
    limits.iter().zip(column).map(|(limit, corner)| u32::from(limit > corner)).sum::<u32>() == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::{Aabb, KeyBox};
    use proptest::prelude::*;

    fn corners(key: &KeyBox) -> Corners {
        let columns: [[i32; WORD_COLUMNS]; 6] = std::array::from_fn(|component| {
            [if component < 3 { key.min[component] } else { key.max[component - 3] }; WORD_COLUMNS]
        });
        let mut out = [[0; 8]; WORD_COLUMNS];
        corners_of(&columns.each_ref(), &mut out);
        assert!(out.iter().all(|c| *c == out[0]));
        out[0]
    }

    proptest! {
        #[test]
        fn reaching_is_overlapping(
            a in prop::array::uniform6(-3i32..3),
            b in prop::array::uniform6(any::<u32>()),
            close in any::<bool>(),
        ) {
            let small = |v: [i32; 6]| KeyBox::from(&Aabb::from(v.map(|x| x as f32)));
            let first = small(a);
            let second = if close {
                small(b.map(|x| (x % 6) as i32 - 3))
            } else {
                KeyBox::from(&Aabb::from(b.map(f32::from_bits)))
            };
            for (p, q) in [(first, second), (second, first), (first, KeyBox::NOTHING)] {
                prop_assert_eq!(reaches(&limits(&corners(&p)), &corners(&q)), p.overlaps(&q));
            }
        }
    }
}
