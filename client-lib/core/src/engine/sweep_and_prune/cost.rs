//! What `cpu-sap` has to do for a frame.

use crate::engine::CostTerm;
use crate::engine::cost::spills;

pub(super) const TERMS: &[CostTerm] = &[
    CostTerm::new(390.0, |_, _| 1.0),
    // A box: read, sorted, put in order.
    CostTerm::new(9.0, |stats, _| stats.boxes()),
    CostTerm::new(3.0, |stats, _| spills(stats)),
    // A pair of a sweep's window. Regardless of what the sample says, each pair that is found was in the window.
    CostTerm::by_lanes(0.42, |stats, _| {
        let valid = stats.boxes() * f64::from(stats.valid_share);
        let window = valid * f64::from(stats.window_share);
        (valid * (window + STRIP_WASTE * window.min(1.0))).max(stats.expected_pairs())
    }),
];

/// Columns of a sweep's window that are compared for nothing: strips are tested whole. Rows without a window have none.
const STRIP_WASTE: f64 = 16.0;
