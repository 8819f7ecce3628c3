//! Two boxes on an axis.

use pairmask_core::aabb::order_key;
use pairmask_core::{Aabb, BoxClass};
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Separation {
    Overlapping,
    Touching,
    Apart,
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct AxisReport {
    pub axis: &'static str,
    pub state: Separation,
    /// Units from the end of one to the start of the other; below 0 an overlap, `None` if endless.
    pub gap: Option<f64>,
    /// The same distance in steps of f32: 1 is the smallest gap.
    gap_ulps: i64,
    /// Start of the later interval.
    starts: String,
    /// End of the interval that ends first.
    ends: String,
}

/// Two boxes on the three axes, where both are valid.
pub(super) fn axes(two: &[Aabb; 2]) -> Option<[AxisReport; 3]> {
    let valid = two.iter().all(|one| one.class() == BoxClass::Valid);
    valid.then(|| [0, 1, 2].map(|axis| AxisReport::of(two, axis)))
}

impl AxisReport {
    fn of([a, b]: &[Aabb; 2], axis: usize) -> Self {
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

    /// The gap in units, or the depth, or a word where that is not finite.
    pub fn gap_text(&self) -> String {
        self.gap.map_or_else(|| "∞".to_owned(), |gap| number(gap.abs()))
    }

    pub fn sentence(&self) -> String {
        let (Self { starts, ends, .. }, gap) = (self, self.gap_text());
        let steps = match self.gap_ulps.unsigned_abs() {
            1 => "1 ulp".to_owned(),
            count => format!("{count} ulps"),
        };
        match self.state {
            Separation::Touching => format!("touching: both at {starts}"),
            Separation::Apart => format!(
                "apart by {gap} units ({steps}): one ends at {ends}, the other starts at {starts}"
            ),
            Separation::Overlapping => {
                format!("overlapping by {gap} units ({steps}), from {starts} to {ends}")
            }
        }
    }
}

/// A number as text: seven digits, plain where that is short, else with an exponent.
pub(super) fn number(x: f64) -> String {
    let x = format!("{x:.6e}").parse().unwrap_or(x);
    if x == 0.0 || (1e-4..1e9).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}
