//! [`by_word`](super::by_word) with AVX2: stray bits of eight words at a time, and bits are found and
//! counted in one instruction each.
#![allow(unsafe_code)]

use super::super::sparse_words::SparseWords;
use super::{SparsePairs, by_word};
use crate::isa::{AvailableIsa, Isa};
use crate::mask::pair_buffer::PairWriter;

/// [`by_word::run`] with AVX2.
#[inline]
pub(super) fn write<'a>(
    pairs: &SparsePairs<'a>,
    writer: &mut PairWriter,
    isa: AvailableIsa,
) -> Option<SparseWords<'a>> {
    assert_eq!(isa.get(), Isa::Avx2, "kernel and instruction set belong together");
    // SAFETY: `isa` is only made where the machine has these features.
    unsafe { run(pairs, writer) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn run<'a>(pairs: &SparsePairs<'a>, writer: &mut PairWriter) -> Option<SparseWords<'a>> {
    by_word::run(pairs, writer)
}
