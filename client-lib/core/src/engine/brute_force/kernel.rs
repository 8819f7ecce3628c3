//! The comparison itself: one row against the 64 columns of a mask word.
//!
//! A kernel is one instruction set's way to do it, and to do what comes before it: buckets and ANDs.

use std::cmp::Ordering;

use super::bitmaps::{BUCKETS, BucketRange, LINE_WORDS, RowStrings};
use super::candidates::{Candidates, address};
use super::corners::{Corners, limits, reaches};
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

    /// Of the columns that `candidates` names, those that the row overlaps.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn hits(row: &Corners, columns: &[Corners; WORD_COLUMNS], candidates: u64) -> u64 {
        let limits = limits(row);
        let (mut hits, mut rest) = (0, candidates);
        while rest != 0 {
            let column = rest.trailing_zeros();
            hits |= u64::from(reaches(&limits, &columns[column as usize])) << column;
            rest &= rest - 1;
        }
        hits
    }

    /// Buckets of 64 keys.
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

    /// Word `word` of every string of a component, for 64 boxes in these buckets. `strings` holds
    /// [`BUCKETS`] strings of one length.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn string_words(
        buckets: &[u8; WORD_COLUMNS],
        range: BucketRange,
        strings: &mut [u64],
        word: usize,
    ) {
        let mut held = [0u64; BUCKETS + 1];
        for (column, &bucket) in buckets.iter().enumerate() {
            held[usize::from(bucket)] |= 1 << column;
        }
        let mut so_far = 0;
        let stride = strings.len() / BUCKETS;
        let strings = strings.chunks_exact_mut(stride);
        match range {
            BucketRange::UpTo => {
                for (string, held) in strings.zip(held) {
                    so_far |= held;
                    string[word] = so_far;
                }
            }
            BucketRange::From => {
                for (string, held) in strings.zip(&held[..BUCKETS]).rev() {
                    so_far |= held;
                    string[word] = so_far;
                }
            }
        }
    }

    /// ANDs the six strings of a row, columns after the row only, and keeps the words that are not
    /// zero.
    ///
    /// # Safety
    /// The CPU must have the kernel's instruction set.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn and_row(strings: &RowStrings<'_>, row: usize, candidates: &mut Candidates) {
        let (first_line, first_word) = first_word(row);
        for line in first_line..strings[0].len() {
            let mut bits = [u64::MAX; LINE_WORDS];
            for string in strings {
                for (bits, string) in bits.iter_mut().zip(&string[line]) {
                    *bits &= string;
                }
            }
            if line == first_line {
                for (word, bits) in bits.iter_mut().enumerate() {
                    // Chosen, not written in part: a SIMD read after a narrow write would stall.
                    *bits &= match word.cmp(&first_word) {
                        Ordering::Less => 0,
                        Ordering::Equal => after_row(row),
                        Ordering::Greater => u64::MAX,
                    };
                }
            }
            if bits.iter().fold(0, |any, bits| any | bits) != 0 {
                candidates.append(|out| {
                    let mut kept = 0;
                    for (word, bits) in bits.into_iter().enumerate() {
                        // Written first and kept if not zero: no branch to mispredict.
                        out.addresses[kept] = address(row, line * LINE_WORDS + word);
                        out.bits[kept] = bits;
                        kept += usize::from(bits != 0);
                    }
                    kept
                });
            }
        }
    }
}

/// Line of a row's string, and word of that line, with the first column after the row or, for the
/// last column of a word, the row itself.
#[inline(always)]
pub(super) const fn first_word(row: usize) -> (usize, usize) {
    let word = row / WORD_COLUMNS;
    (word / LINE_WORDS, word % LINE_WORDS)
}

/// Bits of the columns after `row` in the word that holds it.
#[inline(always)]
pub(super) const fn after_row(row: usize) -> u64 {
    (u64::MAX << (row % WORD_COLUMNS)) << 1
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
