//! The loops around a kernel: rows of a range against all columns after them.
//!
//! Written once, generic over the kernel and always inlined, so that each instruction set gets a
//! copy that is compiled for it.

use std::ops::Range;

use super::bitmaps::{Bitmaps, LINE_WORDS};
use super::candidates::Candidates;
use super::kernel::{Kernel, after_row, columns_of, key_box};
use super::words::WordList;
use crate::aabb::KeyBox;
use crate::engine::ingest::{ColumnWords, WORD_COLUMNS};

/// Candidates of a word from which on it is cheaper to compare all of its columns at once.
const CROWDED: u32 = 6;

/// What the rows are searched in.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    /// Keys of all boxes.
    pub columns: ColumnWords<'a>,
    /// Number of boxes.
    pub n: usize,
    /// Bitmaps of all boxes, where there are enough boxes for them to pay.
    pub bitmaps: Option<&'a Bitmaps>,
}

/// Finds the words of a range of rows. Returns the number of pairs whose keys were compared.
///
/// # Safety
/// The CPU must have the kernel's instruction set.
#[allow(unsafe_code)]
#[inline(always)]
pub(super) unsafe fn find<K: Kernel>(
    scene: &Scene<'_>,
    rows: Range<usize>,
    candidates: &mut Candidates,
    found: &mut WordList,
) -> u64 {
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        match scene.bitmaps {
            None => compare_all::<K>(scene, rows, found),
            Some(bitmaps) => {
                rule_out::<K>(scene, bitmaps, rows, candidates);
                compare_candidates::<K>(scene, bitmaps, candidates, found)
            }
        }
    }
}

/// Compares every row with every column after it.
///
/// # Safety
/// As for [`find`].
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn compare_all<K: Kernel>(
    scene: &Scene<'_>,
    rows: Range<usize>,
    found: &mut WordList,
) -> u64 {
    let words = scene.columns[0].len();
    let mut compared = 0;
    for row in rows {
        let key = key_box(&scene.columns, row);
        if key == KeyBox::NOTHING {
            continue;
        }
        compared += (scene.n - 1 - row) as u64;
        let first = row / WORD_COLUMNS;
        found.make_room(words - first);
        // SAFETY: the caller vouches for the instruction set.
        let lanes = unsafe { K::row(&key) };
        let mut wanted = after_row(row);
        for word in first..words {
            // SAFETY: as above.
            let bits = unsafe { K::word(&lanes, &columns_of(&scene.columns, word)) };
            found.push(row as u32, word as u32, bits & wanted);
            wanted = u64::MAX;
        }
    }
    compared
}

/// ANDs the strings of every row.
///
/// # Safety
/// As for [`find`].
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn rule_out<K: Kernel>(
    scene: &Scene<'_>,
    bitmaps: &Bitmaps,
    rows: Range<usize>,
    candidates: &mut Candidates,
) {
    candidates.clear();
    for row in rows {
        if scene.columns[0][row / WORD_COLUMNS][row % WORD_COLUMNS] == KeyBox::NOTHING.min[0] {
            continue;
        }
        let strings = bitmaps.row(row);
        candidates.make_room(strings[0].len() * LINE_WORDS);
        // SAFETY: the caller vouches for the instruction set.
        unsafe { K::and_row(&strings, row, candidates) };
    }
}

/// Compares the keys of what is left.
///
/// # Safety
/// As for [`find`].
#[allow(unsafe_code)]
#[inline(always)]
unsafe fn compare_candidates<K: Kernel>(
    scene: &Scene<'_>,
    bitmaps: &Bitmaps,
    candidates: &Candidates,
    found: &mut WordList,
) -> u64 {
    let (rows, columns) = (bitmaps.corners(), bitmaps.corners().as_chunks().0);
    let mut compared = 0;
    found.make_room(candidates.len());
    for (row, word, bits) in candidates.iter() {
        compared += u64::from(bits.count_ones());
        let hits = if bits.count_ones() >= CROWDED {
            let key = key_box(&scene.columns, row as usize);
            let columns = columns_of(&scene.columns, word as usize);
            // SAFETY: the caller vouches for the instruction set.
            bits & unsafe { K::word(&K::row(&key), &columns) }
        } else {
            // SAFETY: as above.
            unsafe { K::hits(&rows[row as usize], &columns[word as usize], bits) }
        };
        found.push(row, word, hits);
    }
    compared
}
