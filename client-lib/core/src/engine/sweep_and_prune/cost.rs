//! What `cpu-sap` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::cost::{spills, terms};
use crate::stats::SceneStats;

terms! {
    FRAME = CostTerm::new("sap-frame", 390.0);
    /// A box: read, sorted, put in order.
    BOX = CostTerm::new("sap-box", 14.8);
    /// A box and doubling of a scene above what the caches hold.
    SPILL = CostTerm::new("sap-spill", 6.56);
    /// A pair of a sweep's window.
    TEST = CostTerm::by_lanes("sap-test", 0.465);
}

/// Columns of a sweep's window that are compared for nothing: strips are tested whole.
const STRIP_WASTE: f64 = 8.0;

/// The work of a frame, by the places of the terms.
pub(super) fn work(stats: &SceneStats, amounts: &mut [f64]) {
    let n = f64::from(stats.n.get());
    let solid = n * f64::from(stats.solid_share);
    let window = solid * f64::from(stats.window_share) + STRIP_WASTE;
    amounts[FRAME] = 1.0;
    amounts[BOX] = n;
    amounts[SPILL] = n * spills(n);
    // Whatever the sample says, each pair that is found was in the window.
    amounts[TEST] = (solid * window).max(stats.expected_pairs());
}
