//! What `cpu-grid` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::cost::{spills, terms};
use crate::stats::SceneStats;

terms! {
    FRAME = CostTerm::new("grid-frame", 1_300.0);
    /// A box that is looked at to lay out the cells.
    SAMPLE = CostTerm::new("grid-sample", 13.0);
    /// More for a box that is looked at where sizes differ so much that levels are chosen.
    LEVELS = CostTerm::new("grid-levels", 13.1);
    BOX = CostTerm::by_lanes("grid-box", 25.5);
    /// A box and doubling of a scene above what the caches hold.
    SPILL = CostTerm::new("grid-spill", 2.93);
    /// A box and doubling of the large sizes over the median.
    DOUBLING = CostTerm::by_lanes("grid-doubling", 2.98);
    /// A box and unit of elongation above 2.
    ELONGATION = CostTerm::by_lanes("grid-elongation", 0.938);
}

/// Boxes that the grid looks at to lay out its cells: one in so many …
const SAMPLE_SHARE: f64 = 16.0;
/// … but as many as this, if there are …
const SAMPLE_LEAST: f64 = 256.0;
const SAMPLE_MOST: f64 = 1_024.0;
/// Doublings of the large sizes over the median that are counted: beyond, giants have levels of
/// their own.
const DOUBLINGS_MOST: f64 = 4.0;

/// The work of a frame, by the places of the terms.
pub(super) fn work(stats: &SceneStats, amounts: &mut [f64]) {
    let n = f64::from(stats.n.get());
    let spread = f64::from(stats.large_size / stats.median_size);
    let doublings = if spread.is_finite() { spread.max(1.0).log2() } else { 0.0 };
    let sample = (n / SAMPLE_SHARE).clamp(SAMPLE_LEAST, SAMPLE_MOST).min(n);
    amounts[FRAME] = 1.0;
    amounts[SAMPLE] = sample;
    amounts[LEVELS] = if doublings > 1.0 { sample } else { 0.0 };
    amounts[BOX] = n;
    amounts[SPILL] = n * spills(n);
    amounts[DOUBLING] = n * doublings.min(DOUBLINGS_MOST);
    amounts[ELONGATION] = n * f64::from((stats.elongation - 2.0).max(0.0));
}
