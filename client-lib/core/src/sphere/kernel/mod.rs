//! One sphere against 64: the filter of [`super::exact`], for each instruction set.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

use super::columns::{BallColumns, Columns};
use super::exact::Ball;
use crate::engine::{AvailableIsa, Isa};

/// What the filter says of 64 columns, one bit each. A bit is in one of the two at most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Verdict {
    /// Overlap for certain.
    pub hits: u64,
    /// Near ties: to be decided in integers.
    pub ties: u64,
}

/// A consumer of the non-zero words of a row: word number and bits.
pub(super) trait Take: FnMut(usize, u64) {}
impl<F: FnMut(usize, u64)> Take for F {}

/// Compares a row with all columns after it.
pub(super) fn search(columns: &BallColumns, row: usize, isa: AvailableIsa, take: &mut impl Take) {
    match isa.get() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => avx512::search(columns, row, isa, take),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => avx2::search(columns, row, isa, take),
        _ => search_with(columns, row, take, portable::test),
    }
}

/// The loop around a kernel, compiled for the kernel's instruction set.
#[inline(always)]
fn search_with(
    columns: &BallColumns,
    row: usize,
    take: &mut impl Take,
    test: impl Fn(&Ball, &Columns<'_>) -> Verdict,
) {
    let ball = columns.ball(row);
    let first = row / super::columns::WORD_COLUMNS;
    let words = columns.len().div_ceil(super::columns::WORD_COLUMNS);
    let mut later = (u64::MAX << (row % super::columns::WORD_COLUMNS)) << 1;
    for word in first..words {
        let mut verdict = test(&ball, &columns.word(word));
        verdict.hits &= later;
        verdict.ties &= later;
        later = u64::MAX;
        if verdict.hits | verdict.ties != 0 {
            let bits = verdict.hits | decided(columns, &ball, word, verdict.ties);
            if bits != 0 {
                take(word, bits);
            }
        }
    }
}

/// Of the near ties, those that overlap.
#[inline]
fn decided(columns: &BallColumns, ball: &Ball, word: usize, ties: u64) -> u64 {
    let (mut bits, mut rest) = (0, ties);
    while rest != 0 {
        let column = rest.trailing_zeros();
        let other = columns.ball(word * super::columns::WORD_COLUMNS + column as usize);
        bits |= u64::from(ball.touches(&other)) << column;
        rest &= rest - 1;
    }
    bits
}

#[cfg(test)]
mod tests;
