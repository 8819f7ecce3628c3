//! What `cpu-brute` has to do for a frame.

use super::BITMAP_BOXES;
use crate::engine::CostTerm;
use crate::engine::cost::terms;
use crate::stats::SceneStats;

// With AVX2 and less: of an EPYC 7003 (Zen 3, AVX2), whose other terms are those of the built-in figures.
terms! {
    /// A frame.
    FRAME = CostTerm::new("brute-frame", 366.0);
    /// A box.
    BOX = CostTerm::avx512_or("brute-box", 11.9, 20.0);
    /// A pair that is compared at once, there being too few boxes for bitmaps.
    DIRECT_TEST = CostTerm::by_lanes("brute-direct-test", 0.396);
    /// A frame with bitmaps.
    BITMAP_FRAME = CostTerm::avx512_or("brute-bitmap-frame", 2_414.0, 3_300.0);
    /// More for a box with bitmaps.
    BITMAP_BOX = CostTerm::avx512_or("brute-bitmap-box", 7.13, 13.0);
    /// A pair that is looked up in bitmaps.
    BITMAP_TEST = CostTerm::by_lanes("brute-bitmap-test", 0.0177);
    /// A pair that the bitmaps do not rule out and whose keys are compared.
    CANDIDATE = CostTerm::by_lanes("brute-candidate", 0.261);
}

/// Columns that a row still compares, for each pair that it finds, once the bitmaps have ruled out
/// the rest.
const CANDIDATES_A_PAIR: f64 = 24.0;

/// The work of a frame, by the places of the terms.
pub(super) fn work(stats: &SceneStats, amounts: &mut [f64]) {
    let n = f64::from(stats.n.get());
    let tests = stats.n.pair_count() as f64;
    amounts[FRAME] = 1.0;
    amounts[BOX] = n;
    if stats.n.len() < BITMAP_BOXES {
        amounts[DIRECT_TEST] = tests;
    } else {
        amounts[BITMAP_FRAME] = 1.0;
        amounts[BITMAP_BOX] = n;
        amounts[BITMAP_TEST] = tests;
        amounts[CANDIDATE] = (CANDIDATES_A_PAIR * stats.expected_pairs()).min(tests);
    }
}
