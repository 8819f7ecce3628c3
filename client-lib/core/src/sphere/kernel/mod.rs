//! One sphere against 64: the filter of [`super::exact`], for each instruction set.

#[cfg(target_arch = "x86_64")]
mod avx2;

use super::columns::{BallColumns, Columns, WORD_COLUMNS};
use super::exact::{Ball, LESS};
use crate::engine::AvailableIsa;
#[cfg(target_arch = "x86_64")]
use crate::engine::Isa;
use crate::simd::per_isa;

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
    // Of the plain test, which compilers turn into SIMD, that of AVX2 takes a quarter longer than by intrinsics.
    #[cfg(target_arch = "x86_64")]
    if isa.get() == Isa::Avx2 {
        return avx2::search(columns, row, isa, take);
    }
    search_plain(columns, row, take, isa);
}

per_isa! {
    fn search_plain<simd: S, T: Take>(columns: &BallColumns, row: usize, take: &mut T) {
        let _ = simd;
        search_with(columns, row, take, test);
    }
}

/// Tests 64 columns, in a form that compilers turn into any SIMD that they have.
#[inline(always)]
fn test(ball: &Ball, columns: &Columns<'_>) -> Verdict {
    let [x, y, z, radius] = columns;
    let (mut hits, mut near) = (0, 0);
    for t in 0..WORD_COLUMNS {
        let (dx, dy, dz) = (ball.center[0] - x[t], ball.center[1] - y[t], ball.center[2] - z[t]);
        let distance = dx * dx + dy * dy + dz * dz;
        let reach = ball.radius + radius[t];
        let reach = reach * reach;
        let bit = 1 << t;
        hits |= if distance <= reach * LESS { bit } else { 0 };
        near |= if distance * LESS <= reach { bit } else { 0 };
    }
    Verdict { hits, ties: near & !hits }
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
    let first = row / WORD_COLUMNS;
    let words = columns.len().div_ceil(WORD_COLUMNS);
    let mut later = (u64::MAX << (row % WORD_COLUMNS)) << 1;
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
        let other = columns.ball(word * WORD_COLUMNS + column as usize);
        bits |= u64::from(ball.touches(&other)) << column;
        rest &= rest - 1;
    }
    bits
}
