//! The comparison itself: one row against the 64 columns of a mask word.
//!
//! A kernel is one instruction set's way to do it, and to do what comes before it: buckets and ANDs.

use super::bitmaps::LINE_WORDS;
use super::candidates::Candidates;
use super::quantiles::Borders;
use crate::aabb::KeyBox;
use crate::engine::ingest::{ColumnWords, WORD_COLUMNS};

/// The six keys of 64 columns.
pub(super) type Columns<'a> = [&'a [i32; WORD_COLUMNS]; 6];

/// One instruction set's comparison.
pub(super) trait Kernel {
    /// A row's six keys, each in all lanes of a register.
    type Row: Copy;

    /// Spreads a row's keys over registers.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    unsafe fn row(key: &KeyBox) -> Self::Row;

    /// Bit t: the row overlaps column t.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    unsafe fn word(row: &Self::Row, columns: &Columns<'_>) -> u64;

    /// Buckets of 64 keys. Those of [`KeyBox::NOTHING`] may be any.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn buckets(keys: &[i32; WORD_COLUMNS], borders: &Borders, out: &mut [u8; WORD_COLUMNS]) {
        for (key, out) in keys.iter().zip(out) {
            *out = borders.bucket(*key);
        }
    }

    /// ANDs one line of six strings and of `wanted`, and keeps the words that are not zero.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn and_line(
        strings: [&[u64; LINE_WORDS]; 6],
        wanted: &[u64; LINE_WORDS],
        row: u32,
        line: usize,
        candidates: &mut Candidates,
    ) {
        let mut bits = *wanted;
        for string in strings {
            for (bits, string) in bits.iter_mut().zip(string) {
                *bits &= string;
            }
        }
        if bits.iter().fold(0, |any, bits| any | bits) != 0 {
            for (word, bits) in bits.into_iter().enumerate() {
                candidates.push(row, (line * LINE_WORDS + word) as u32, bits);
            }
        }
    }
}

/// Whether a row overlaps one column of a word, without a branch.
#[inline(always)]
pub(super) fn overlaps_column(row: &KeyBox, columns: &Columns<'_>, column: usize) -> bool {
    let key = |component: usize| columns[component][column];
    (row.min[0] <= key(3))
        & (key(0) <= row.max[0])
        & (row.min[1] <= key(4))
        & (key(1) <= row.max[1])
        & (row.min[2] <= key(5))
        & (key(2) <= row.max[2])
}

/// The six keys of a box.
#[inline(always)]
pub(super) fn key_box(columns: &ColumnWords<'_>, index: usize) -> KeyBox {
    let (word, lane) = (index / WORD_COLUMNS, index % WORD_COLUMNS);
    let key = |component: usize| columns[component][word][lane];
    KeyBox { min: [key(0), key(1), key(2)], max: [key(3), key(4), key(5)] }
}

/// The columns of one mask word.
#[inline(always)]
pub(super) fn columns_of<'a>(columns: &ColumnWords<'a>, word: usize) -> Columns<'a> {
    std::array::from_fn(|component| &columns[component][word])
}
