//! What `cpu-brute` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::cost::terms;
use crate::engine::ingest::WORD_COLUMNS;
use crate::stats::SceneStats;

// With AVX2 and less: of an EPYC 7003 (Zen 3, AVX2), whose other terms are those of the built-in figures.
terms! {
    FRAME = CostTerm::new("brute-frame", 366.0);
    BOX = CostTerm::avx512_or("brute-box", 11.9, 20.0);
    /// A column that is compared, of words that are compared whole.
    TEST = CostTerm::by_lanes("brute-test", 0.17);
}

/// The work of a frame, by the places of the terms.
pub(super) fn work(stats: &SceneStats, amounts: &mut [f64]) {
    let n = f64::from(stats.n.get());
    amounts[FRAME] = 1.0;
    amounts[BOX] = n;
    // The word of the row itself is half in vain.
    amounts[TEST] = stats.n.pair_count() as f64 + n * (WORD_COLUMNS / 2) as f64;
}
