//! What `cpu-tree` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::cost::spills;

pub(super) const TERMS: &[CostTerm] = &[
    CostTerm::new(900.0, |_, _| 1.0),
    // A box: read, and compared with the groups that it meets.
    CostTerm::by_lanes(60.0, |stats, _| stats.boxes()),
    // A box and halving of the scene down to a group that is not cut.
    CostTerm::new(5.0, |stats, _| stats.boxes() * (stats.boxes() / 16.0).max(1.0).log2()),
    CostTerm::new(3.0, |stats, _| spills(stats)),
];
