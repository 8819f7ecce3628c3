//! One thread's share of a frame.

use std::ops::Range;

use super::search;
use super::words::WordList;
use crate::cancel::{Cancel, Pace};
use crate::engine::encode::{DenseWindow, FoundWords};
use crate::engine::gather::Gather;
use crate::engine::ingest::KeyColumns;

/// Rows that go through all stages together: few enough that what one stage leaves is still in the
/// cache for the next. Fewer in large scenes, whose rows take long: between batches, it is looked whether the mask is
/// still wanted.
const BATCH_ROWS: usize = 64;

/// A range of rows, what was found in them, and the scratch for it.
#[derive(Default)]
pub(super) struct Task {
    pub rows: Range<usize>,
    pub found: WordList,
    pub compared: u64,
    pub pair_count: u64,
    /// Bits for the word after this task's window.
    pub carry: u32,
}

impl Task {
    /// Takes over a range of rows and drops the last frame.
    pub fn assign(&mut self, rows: Range<usize>) {
        self.rows = rows;
        self.found.clear();
        (self.compared, self.pair_count, self.carry) = (0, 0, 0);
    }

    /// Finds the words of all rows and keeps them, until the budget is spent.
    pub fn run(&mut self, columns: &KeyColumns, gather: &Gather<'_>) {
        let mut pace = Pace::default();
        for rows in batches(self.rows.clone(), columns.len()) {
            let tests = tests_of(&rows, columns);
            let before = self.found.len();
            self.find(columns, rows, gather);
            self.found.sift(before, gather);
            if !gather.budget.take(&self.found.arrays()[2][before..])
                || gather.budget.cancel().look_after(tests, &mut pace)
            {
                return;
            }
        }
        self.pair_count = self.found.pair_count();
    }

    /// Finds the words of all rows and writes them into the window of this task.
    pub fn run_into(
        &mut self,
        columns: &KeyColumns,
        gather: &Gather<'_>,
        mut window: DenseWindow<'_>,
    ) {
        let (cancel, mut pace) = (gather.budget.cancel(), Pace::default());
        window.clear(cancel);
        for rows in batches(self.rows.clone(), columns.len()) {
            if cancel.look_after(tests_of(&rows, columns), &mut pace) {
                return;
            }
            self.found.clear();
            self.find(columns, rows, gather);
            self.found.sift(0, gather);
            self.pair_count += self.found.pair_count();
            window.write(self.found.arrays());
        }
        self.carry = window.carry();
    }

    fn find(&mut self, columns: &KeyColumns, rows: Range<usize>, gather: &Gather<'_>) {
        let (words, n) = (columns.words(), columns.len());
        self.compared += search::find(&words, n, rows, &mut self.found, gather.isa);
    }
}

fn tests_of(rows: &Range<usize>, columns: &KeyColumns) -> u64 {
    rows.len() as u64 * columns.len() as u64
}

fn batches(rows: Range<usize>, n: usize) -> impl Iterator<Item = Range<usize>> {
    let count = Cancel::rows_at_once(n, BATCH_ROWS);
    rows.clone().step_by(count).map(move |start| start..rows.end.min(start + count))
}
