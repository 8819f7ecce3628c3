//! What `cpu-grid` has to do for a frame.

use super::sample::sample_size;
use crate::engine::CostTerm;
use crate::engine::cost::spills;
use crate::stats::SceneStats;

pub(super) const TERMS: &[CostTerm] = &[
    CostTerm::new(1_300.0, |_, _| 1.0),
    // A box that is looked at to lay out the cells.
    CostTerm::new(13.0, |stats, _| sample_size(stats.n.len()) as f64),
    // More for one where sizes differ so much that levels are chosen.
    CostTerm::new(13.1, |stats, _| {
        if doublings(stats) > 1.0 { sample_size(stats.n.len()) as f64 } else { 0.0 }
    }),
    CostTerm::by_lanes(25.5, |stats, _| stats.boxes()),
    CostTerm::new(2.93, |stats, _| spills(stats)),
    // A box and doubling of the large sizes over the median.
    CostTerm::by_lanes(2.0, |stats, _| stats.boxes() * doublings(stats).min(DOUBLINGS_MOST)),
    // A box and unit of elongation above 2.
    CostTerm::by_lanes(0.938, |stats, _| {
        stats.boxes() * f64::from((stats.elongation - 2.0).max(0.0))
    }),
];

/// Doublings of the large sizes over the median that are counted: beyond, giants have levels of
/// their own.
const DOUBLINGS_MOST: f64 = 4.0;

fn doublings(stats: &SceneStats) -> f64 {
    let spread = f64::from(stats.large_size / stats.median_size);
    if spread.is_finite() { spread.max(1.0).log2() } else { 0.0 }
}
