//! One thread's share of a frame.

use std::ops::Range;

use super::dense::{DenseWindow, first_word};
use super::words::WordList;
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};
use super::{kernel, portable};
use crate::engine::ingest::KeyColumns;
use crate::engine::{AvailableIsa, Isa};

/// Rows whose words are found before they go into a dense mask: few enough that the words are
/// still in the cache then.
const DENSE_ROWS: usize = 32;

/// A range of rows, what was found in them, and the scratch for it.
#[derive(Default)]
pub(super) struct Task {
    rows: Range<usize>,
    found: WordList,
    /// Pairs compared.
    pub compared: u64,
    /// Pairs found.
    pub pair_count: u64,
    /// Bits for the dense word after this task's window.
    pub carry: u32,
}

impl Task {
    /// Takes over a range of rows and forgets the last frame.
    pub fn assign(&mut self, rows: Range<usize>) {
        self.rows = rows;
        self.found.clear();
        (self.compared, self.pair_count, self.carry) = (0, 0, 0);
    }

    /// The rows of this task.
    pub fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }

    /// The words found, sparse encoding.
    pub fn found(&self) -> &WordList {
        &self.found
    }

    /// Finds the words of all rows and keeps them.
    pub fn run_sparse(&mut self, columns: &KeyColumns, isa: AvailableIsa) {
        self.compared = compare_rows(columns, self.rows.clone(), &mut self.found, isa);
        self.pair_count = self.found.pair_count();
    }

    /// Finds the words of all rows and writes them into `words`, the window of this task.
    pub fn run_dense(&mut self, columns: &KeyColumns, isa: AvailableIsa, words: &mut [u32]) {
        let n = columns.len();
        let mut window = DenseWindow::new(words, first_word(self.rows.start, n), n);
        for start in self.rows.clone().step_by(DENSE_ROWS) {
            let rows = start..self.rows.end.min(start + DENSE_ROWS);
            self.found.clear();
            self.compared += compare_rows(columns, rows, &mut self.found, isa);
            self.pair_count += self.found.pair_count();
            window.write(&self.found);
        }
        self.carry = window.carry();
    }
}

fn compare_rows(
    columns: &KeyColumns,
    rows: Range<usize>,
    found: &mut WordList,
    isa: AvailableIsa,
) -> u64 {
    let (n, columns) = (columns.len(), &columns.words());
    match isa.get() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => avx512::compare_rows(columns, rows, n, found, isa),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => avx2::compare_rows(columns, rows, n, found, isa),
        #[cfg(target_arch = "aarch64")]
        Isa::Neon => {
            // SAFETY: every aarch64 has NEON.
            #[allow(unsafe_code)]
            unsafe {
                kernel::compare_rows::<super::neon::Neon>(columns, rows, n, found)
            }
        }
        _ => {
            // SAFETY: plain Rust needs no instruction set.
            #[allow(unsafe_code)]
            unsafe {
                kernel::compare_rows::<portable::Portable>(columns, rows, n, found)
            }
        }
    }
}
