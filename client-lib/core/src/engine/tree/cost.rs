//! What `cpu-tree` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::cost::{spills, terms};
use crate::stats::SceneStats;

terms! {
    FRAME = CostTerm::new("tree-frame", 900.0);
    /// A box: read, and compared with the groups that it meets.
    BOX = CostTerm::by_lanes("tree-box", 60.0);
    /// A box and halving of the scene down to 16.
    CUT = CostTerm::new("tree-cut", 9.0);
    /// A box and doubling of a scene above what the caches hold.
    SPILL = CostTerm::new("tree-spill", 3.0);
}

/// Boxes of a group that is not cut.
const UNCUT: f64 = 16.0;

/// The work of a frame, by the places of the terms.
pub(super) fn work(stats: &SceneStats, amounts: &mut [f64]) {
    let n = f64::from(stats.n.get());
    amounts[FRAME] = 1.0;
    amounts[BOX] = n;
    amounts[CUT] = n * (n / UNCUT).max(1.0).log2();
    amounts[SPILL] = n * spills(n);
}
