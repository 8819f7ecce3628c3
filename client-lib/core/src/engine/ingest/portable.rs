//! Ingest in plain Rust.

use super::ColumnsMut;
use crate::aabb::{Aabb, KeyBox};
use crate::engine::Census;

/// Keys of the boxes from `first` on.
pub(super) fn fill(
    boxes: &[Aabb],
    first: usize,
    columns: &mut ColumnsMut<'_>,
    census: &mut Census,
) {
    for (i, b) in boxes.iter().enumerate().skip(first) {
        let (key, class) = KeyBox::classify(b);
        for axis in 0..3 {
            columns[axis][i] = key.min[axis];
            columns[3 + axis][i] = key.max[axis];
        }
        census.note(i as u32, class);
    }
}
