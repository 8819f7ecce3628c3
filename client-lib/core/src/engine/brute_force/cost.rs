//! What `cpu-brute` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::ingest::WORD_COLUMNS;

// With AVX2 and less: of an EPYC 7003 (Zen 3, AVX2), whose other terms are those of the built-in figures.
pub(super) const TERMS: &[CostTerm] = &[
    CostTerm::new(366.0, |_, _| 1.0),
    CostTerm::avx512_or(11.9, 20.0, |stats, _| stats.boxes()),
    // Columns that are compared, of words that are compared whole. The word of the row itself is half in vain.
    CostTerm::by_lanes(0.17, |stats, _| {
        stats.n.pair_count() as f64 + stats.boxes() * (WORD_COLUMNS / 2) as f64
    }),
];
