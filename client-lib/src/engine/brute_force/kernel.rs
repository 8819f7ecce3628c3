//! The comparison itself: one row against the 64 columns of a mask word.
//!
//! A kernel is one instruction set's way to do it. The loops around it are written once, generic
//! over the kernel and always inlined, so that each set gets a copy compiled for it.

use std::ops::Range;

use super::words::WordList;
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

/// Compares every row of a range with every column after it. Returns the number of pairs compared.
///
/// # Safety
/// The CPU must have the kernel's instruction set.
#[allow(unsafe_code)]
#[inline(always)]
pub(super) unsafe fn compare_rows<K: Kernel>(
    columns: &ColumnWords<'_>,
    rows: Range<usize>,
    n: usize,
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
        // SAFETY: the caller vouches for the instruction set.
        let lanes = unsafe { K::row(&key) };
        let mut wanted = after_row(row);
        for word in first..words {
            // SAFETY: as above.
            let bits = unsafe { K::word(&lanes, &columns_of(columns, word)) };
            found.push(row as u32, word as u32, bits & wanted);
            wanted = u64::MAX;
        }
    }
    compared
}
