//! Range-encoded bitmaps: six ANDs rule out most of 64 (with AVX-512: 512) columns at a time.
//!
//! Each axis is cut into [`BUCKETS`] buckets. For each axis and bucket q there are two strings of
//! one bit a box: "min lies in bucket q or below" and "max lies in bucket q or above" (a
//! range-encoded bitmap index, Chan and Ioannidis 1998). Taking a number to its bucket is monotone,
//! so `a.min <= b.max` carries over to the buckets, and the AND of a row's six strings keeps
//! **every** column that overlaps it. The few others that it keeps fall to the comparison of keys
//! afterwards.
//!
//! Bucket borders are quantiles of a sample, so that a cluster or a far outlier costs no more than
//! its share of buckets. Borders change how much is ruled out, and never the answer.

use super::corners::{Corners, corners_of};
use super::kernel::Kernel;
use super::quantiles::Borders;
use crate::aligned::AlignedBuffer;
use crate::engine::ingest::{ColumnWords, WORD_COLUMNS};

/// Buckets an axis. More rule out more and fill the cache: a scene of 4,096 boxes has 196 kB of
/// strings.
pub(super) const BUCKETS: usize = 64;

/// Words of a cache line: strings are padded to whole ones, so that a SIMD load may run past the
/// last column.
pub(super) const LINE_WORDS: usize = 8;

/// Which boxes a string names.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum BucketRange {
    /// Those in its bucket and below.
    UpTo,
    /// Those in its bucket and above.
    From,
}

/// The bitmaps of one frame. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct Bitmaps {
    /// String q of component c starts at `(BUCKETS·c + q)·stride`. Components are in wire order.
    strings: AlignedBuffer<u64>,
    /// Words of a string.
    stride: usize,
    /// Bucket of every key, one array a component.
    buckets: AlignedBuffer<u8>,
    /// Length of a bucket array.
    padded_len: usize,
    /// Corners of every box, for the comparison of single pairs.
    corners: AlignedBuffer<Corners>,
}

/// The strings that a row's columns must be in, all of them.
pub(super) type RowStrings<'a> = [&'a [[u64; LINE_WORDS]]; 6];

impl Bitmaps {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.strings.allocated_bytes()
            + self.buckets.allocated_bytes()
            + self.corners.allocated_bytes()
    }

    /// Builds the strings of all boxes.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    #[inline(always)]
    pub unsafe fn build<K: Kernel>(&mut self, columns: &ColumnWords<'_>, n: usize) {
        let words = columns[0].len();
        self.padded_len = words * WORD_COLUMNS;
        self.stride = words.next_multiple_of(LINE_WORDS);
        self.buckets.resize(6 * self.padded_len);
        self.strings.resize(6 * BUCKETS * self.stride);
        let buckets = self.buckets.as_mut_slice().as_chunks_mut::<WORD_COLUMNS>().0;
        for axis in 0..3 {
            let borders = Borders::of_sample(columns[axis], columns[3 + axis], n);
            for component in [axis, 3 + axis] {
                let out = &mut buckets[component * words..][..words];
                for (keys, out) in columns[component].iter().zip(out) {
                    // SAFETY: the caller vouches for the instruction set.
                    unsafe { K::buckets(keys, &borders, out) };
                }
            }
        }
        self.corners.resize(self.padded_len);
        let (chunks, _) = self.corners.as_mut_slice().as_chunks_mut();
        for (word, corners) in chunks.iter_mut().enumerate() {
            corners_of(&std::array::from_fn(|component| &columns[component][word]), corners);
        }
        let stride = self.stride;
        let strings = self.strings.as_mut_slice();
        for component in 0..6 {
            let range = if component < 3 { BucketRange::UpTo } else { BucketRange::From };
            let strings = &mut strings[component * BUCKETS * stride..][..BUCKETS * stride];
            for (word, buckets) in buckets[component * words..][..words].iter().enumerate() {
                // SAFETY: as above.
                unsafe { K::string_words(buckets, range, strings, word) };
            }
            for string in strings.chunks_exact_mut(stride) {
                string[words..].fill(0);
            }
        }
    }

    /// The corners of all boxes, padding included.
    #[inline(always)]
    pub fn corners(&self) -> &[Corners] {
        self.corners.as_slice()
    }

    /// The six strings for a row: mins up to the bucket of its max, maxes from that of its min.
    #[inline(always)]
    pub fn row(&self, row: usize) -> RowStrings<'_> {
        let buckets = self.buckets.as_slice();
        let strings = self.strings.as_slice();
        std::array::from_fn(|component| {
            let opposite = (component + 3) % 6;
            let q = usize::from(buckets[opposite * self.padded_len + row]);
            strings[(component * BUCKETS + q) * self.stride..][..self.stride].as_chunks().0
        })
    }
}
