//! Ingest: boxes as they lie in shared memory → integer keys, one array a coordinate.
//!
//! Each box is read once. After that an engine looks only at its own copy, so a client that writes
//! while its frame is being culled can spoil its own answer and nothing else.

use crate::aabb::{Aabb, KeyBox};
use crate::aligned::AlignedBuffer;
use crate::cancel::Cancel;
use crate::engine::strips::{self, KeyArraysMut};
use crate::engine::{AvailableIsa, Census, CullError, NAMED_INVALID};
use crate::simd::{Simd, per_isa};

/// Columns that one 64-bit mask word covers: the granule that key arrays are padded to.
pub const WORD_COLUMNS: usize = 64;

/// Boxes that are read between two looks whether anybody waits for the answer: some 50 µs. A multiple of all registers.
const READ_AT_ONCE: usize = 1 << 14;

/// The keys of all boxes, one array for each of the six coordinates, on 64-byte borders.
///
/// The arrays are padded to a multiple of [`WORD_COLUMNS`] with [`KeyBox::NOTHING`], which is also
/// what empty and invalid boxes become. Memory is kept from frame to frame.
#[derive(Default)]
pub(crate) struct KeyColumns {
    keys: AlignedBuffer<i32>,
    len: usize,
    padded_len: usize,
}

impl KeyColumns {
    /// Reads all boxes and counts those that overlap nothing.
    ///
    /// # Errors
    /// [`CullError::Cancelled`].
    ///
    /// # Panics
    /// When the system has no memory for 24 bytes a box (the first time that so many boxes come).
    pub fn ingest(
        &mut self,
        boxes: &[Aabb],
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Result<Census, CullError> {
        self.len = boxes.len();
        self.padded_len = boxes.len().next_multiple_of(WORD_COLUMNS);
        self.keys.resize(6 * self.padded_len);
        let mut census = Census::default();
        if boxes.is_empty() {
            return Ok(census);
        }
        let mut columns = split_columns(self.keys.as_mut_slice(), self.padded_len);
        for (some, first) in boxes.chunks(READ_AT_ONCE).zip((0..).step_by(READ_AT_ONCE)) {
            if first > 0 && cancel.look() {
                return Err(CullError::Cancelled);
            }
            let mut columns = columns.each_mut().map(|column| &mut column[first..]);
            let mut of_some = Census::default();
            fill(some, &mut columns, &mut of_some, isa);
            census = census.then(&of_some.behind(first as u32));
        }
        for (column, nothing) in columns.iter_mut().zip(strips::NOTHING) {
            column[boxes.len()..].fill(nothing);
        }
        Ok(census)
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.keys.allocated_bytes()
    }

    /// Boxes ingested.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The six key arrays in steps of one mask word: min x, y, z, max x, y, z.
    pub(crate) fn words(&self) -> ColumnWords<'_> {
        let keys = self.keys.as_slice();
        std::array::from_fn(|component| {
            keys[component * self.padded_len..][..self.padded_len].as_chunks().0
        })
    }
}

/// The six key arrays, cut into the columns of one 64-bit mask word each.
pub(crate) type ColumnWords<'a> = [&'a [[i32; WORD_COLUMNS]]; 6];

/// Keys of six arrays of one length, one after the other, as those arrays.
pub(crate) fn split_columns(keys: &mut [i32], padded_len: usize) -> KeyArraysMut<'_> {
    let mut rest = keys;
    [(); 6].map(|()| {
        let (column, tail) = std::mem::take(&mut rest).split_at_mut(padded_len);
        rest = tail;
        column
    })
}

per_isa! {
    /// Keys of all boxes: a register of boxes a step, and the last few, fewer than that, one by one.
    pub(crate) fn fill<simd: S>(boxes: &[Aabb], columns: &mut KeyArraysMut<'_>, census: &mut Census) {
        let steps = boxes.chunks_exact(S::LANES);
        let rest = boxes.len() - steps.remainder().len();
        for (step, boxes) in steps.enumerate() {
            let first = step * S::LANES;
            let (keys, nan, empty) = keys_of(simd, simd.coordinates(boxes));
            for (column, key) in columns.iter_mut().zip(keys) {
                simd.store(key, &mut column[first..first + S::LANES]);
            }
            if (nan | empty) != 0 {
                note_group(census, first, nan, empty);
            }
        }
        for (i, b) in boxes.iter().enumerate().skip(rest) {
            let (key, class) = KeyBox::classify(b);
            for axis in 0..3 {
                columns[axis][i] = key.min[axis];
                columns[3 + axis][i] = key.max[axis];
            }
            census.note(i as u32, class);
        }
    }
}

/// Keys, and the lanes of boxes with a NaN and of boxes with `min > max`.
#[inline(always)]
fn keys_of<S: Simd>(simd: S, bits: [S::Keys; 6]) -> ([S::Keys; 6], u32, u32) {
    let mut keys = bits;
    for key in &mut keys {
        *key = simd.order_keys(*key);
    }
    let mut nan = simd.unordered(bits[0], bits[3]);
    let mut empty = simd.above(keys[0], keys[3]);
    for axis in 1..3 {
        nan = simd.either(nan, simd.unordered(bits[axis], bits[3 + axis]));
        empty = simd.either(empty, simd.above(keys[axis], keys[3 + axis]));
    }
    let nothing = simd.either(nan, empty);
    for axis in 0..3 {
        let (min, max) = (KeyBox::NOTHING.min[axis], KeyBox::NOTHING.max[axis]);
        keys[axis] = simd.select(nothing, simd.splat(min), keys[axis]);
        keys[3 + axis] = simd.select(nothing, simd.splat(max), keys[3 + axis]);
    }
    (keys, simd.bits(nan), simd.bits(empty))
}

/// Counts a group of boxes from two masks: bit t is box `first + t`. NaN wins over empty.
#[inline]
fn note_group(census: &mut Census, first: usize, nan: u32, empty: u32) {
    census.empty += (empty & !nan).count_ones();
    let mut rest = nan;
    while rest != 0 && (census.invalid as usize) < NAMED_INVALID {
        census.first_invalid[census.invalid as usize] = first as u32 + rest.trailing_zeros();
        census.invalid += 1;
        rest &= rest - 1;
    }
    census.invalid += rest.count_ones();
}
