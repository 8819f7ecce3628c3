//! Boxes in an engine's order: six key arrays and the box index at each position.

use super::STRIP_COLUMNS;
use crate::aabb::KeyBox;
use crate::aligned::AlignedBuffer;
use crate::engine::ingest::split_columns;

/// The six key arrays, in wire order: min x, y, z, max x, y, z.
pub(crate) type KeyArrays<'a> = [&'a [i32]; 6];

/// [`KeyArrays`], to be written.
pub(crate) type KeyArraysMut<'a> = [&'a mut [i32]; 6];

/// Of each array the key of what overlaps nothing.
pub(crate) const NOTHING: [i32; 6] = {
    let KeyBox { min, max } = KeyBox::NOTHING;
    [min[0], min[1], min[2], max[0], max[1], max[2]]
};

/// Keys and indices of all boxes by position. Memory is kept from frame to frame.
///
/// Each key array is longer than the boxes by at least [`STRIP_COLUMNS`], so that a strip may
/// start at any position and be loaded whole.
#[derive(Default)]
pub(crate) struct OrderedBoxes {
    keys: AlignedBuffer<i32>,
    order: AlignedBuffer<u32>,
    stride: usize,
}

impl OrderedBoxes {
    /// Makes room for `n` boxes; their keys and indices are unspecified until written.
    ///
    /// # Panics
    /// When the system has no memory for it.
    pub fn resize(&mut self, n: usize) {
        self.stride = (n + STRIP_COLUMNS).next_multiple_of(STRIP_COLUMNS);
        // A stride that is a multiple of 4 KiB would put the six keys of a box into the same
        // cache set.
        if (self.stride * size_of::<i32>()).is_multiple_of(4096) {
            self.stride += 5 * STRIP_COLUMNS;
        }
        self.keys.resize(6 * self.stride);
        self.order.resize(n);
        self.empty_from(n);
    }

    /// The boxes from this position on, and the padding, become what overlaps nothing.
    pub fn empty_from(&mut self, position: usize) {
        let keys = self.keys.as_mut_slice().chunks_exact_mut(self.stride);
        for (array, nothing) in keys.zip(NOTHING) {
            array[position..].fill(nothing);
        }
    }

    pub fn allocated_bytes(&self) -> usize {
        self.keys.allocated_bytes() + self.order.allocated_bytes()
    }

    /// Keys by position, padding included.
    pub fn keys(&self) -> KeyArrays<'_> {
        if self.stride == 0 {
            return [&[]; 6];
        }
        let keys = self.keys.as_slice();
        std::array::from_fn(|component| &keys[component * self.stride..][..self.stride])
    }

    /// Box index at each position.
    pub fn order(&self) -> &[u32] {
        self.order.as_slice()
    }

    /// Keys (without the padding) and indices, to be written.
    pub fn parts_mut(&mut self) -> (KeyArraysMut<'_>, &mut [u32]) {
        let n = self.order.as_slice().len();
        let keys = split_columns(self.keys.as_mut_slice(), self.stride);
        (keys.map(|array| &mut array[..n]), self.order.as_mut_slice())
    }
}

/// The keys before a position, and those from it on.
pub(crate) fn split_keys(
    mut keys: KeyArraysMut<'_>,
    at: usize,
) -> (KeyArraysMut<'_>, KeyArraysMut<'_>) {
    let later = keys.each_mut().map(|array| {
        let (here, later) = std::mem::take(array).split_at_mut(at);
        *array = here;
        later
    });
    (keys, later)
}
