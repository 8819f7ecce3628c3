//! The gap between two boxes on one axis, in units and in steps of f32.

use pairmask_core::Aabb;
use pairmask_core::aabb::order_key;
use serde::Serialize;

/// How two intervals relate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Separation {
    /// The intervals share more than a point.
    Overlapping,
    /// The intervals share one point.
    Touching,
    /// The intervals share no point.
    Apart,
}

/// Two solid boxes on one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisReport {
    /// `x`, `y` or `z`.
    pub axis: &'static str,
    /// How the intervals relate.
    pub state: Separation,
    /// Distance from the end of the interval that ends first to the start of the other, units.
    /// Below 0 the length of the overlap. Null where that is not finite.
    pub gap: Option<f64>,
    /// The same distance in steps of f32: 1 is the smallest gap.
    pub gap_ulps: i64,
    /// Start of the later interval.
    pub starts: String,
    /// End of the interval that ends first.
    pub ends: String,
}

impl AxisReport {
    /// Two solid boxes on axis 0, 1 or 2.
    pub(super) fn of(a: &Aabb, b: &Aabb, axis: usize) -> Self {
        let key = |x: f32| i64::from(order_key(x.to_bits()));
        let starts = if key(a.min[axis]) >= key(b.min[axis]) { a.min[axis] } else { b.min[axis] };
        let ends = if key(a.max[axis]) <= key(b.max[axis]) { a.max[axis] } else { b.max[axis] };
        let gap_ulps = key(starts) - key(ends);
        // Exact unless the exponents differ by more than 28, and then to 53 bits.
        let gap = f64::from(starts) - f64::from(ends);
        Self {
            axis: ["x", "y", "z"][axis],
            state: match gap_ulps {
                ..0 => Separation::Overlapping,
                0 => Separation::Touching,
                1.. => Separation::Apart,
            },
            gap: gap.is_finite().then_some(gap),
            gap_ulps,
            starts: format!("{starts:?}"),
            ends: format!("{ends:?}"),
        }
    }

    /// The gap in units, or in words where it is not finite.
    pub fn gap_text(&self) -> String {
        match self.gap {
            Some(gap) => number(gap),
            None => "∞".to_owned(),
        }
    }
}

/// A number as text: seven digits, plain where that is short, else with an exponent.
pub(super) fn number(x: f64) -> String {
    let x = format!("{x:.6e}").parse().unwrap_or(x);
    if x == 0.0 || (1e-4..1e9).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}
