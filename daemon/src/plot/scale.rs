//! Scales: the place of a value along an axis.

use super::unit::Unit;

/// Share of the axis that a logarithmic scale keeps for the value zero.
const ZERO_LANE: f64 = 0.12;

/// A scale over a range of values. Places run from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// From 0 to `end`.
    Linear {
        /// Largest value.
        end: f64,
    },
    /// From one round number to another, both 1, 2 or 5 times a power of ten.
    Log {
        /// Smallest value.
        from: f64,
        /// Largest value.
        to: f64,
        /// Whether zero has a lane of its own before the smallest.
        zero: bool,
    },
}

/// A mark on an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Where, from 0 to 1.
    pub at: f64,
    /// The label.
    pub label: String,
}

impl Scale {
    /// From 0 to a round number at or above the largest value.
    pub fn linear(values: impl IntoIterator<Item = f64>) -> Self {
        let largest = values.into_iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
        if largest <= 0.0 {
            return Self::Linear { end: 1.0 };
        }
        let step = round_step(largest);
        Self::Linear { end: (largest / step).ceil() * step }
    }

    /// Round numbers around the positive values; a lane for zero where one of them is zero.
    pub fn log(values: impl IntoIterator<Item = f64>) -> Self {
        let (mut least, mut largest, mut zero) = (f64::INFINITY, 0.0f64, false);
        for value in values.into_iter().filter(|v| v.is_finite()) {
            if value > 0.0 {
                least = least.min(value);
                largest = largest.max(value);
            } else {
                zero = true;
            }
        }
        if largest <= 0.0 {
            return Self::Log { from: 0.1, to: 1.0, zero };
        }
        // A computed round number may differ from the exact one by a rounding error.
        let nearly = 1.0 + 1e-9;
        let from = round_numbers(least).filter(|r| *r <= least * nearly).last();
        let to = round_numbers(largest).find(|r| *r * nearly >= largest && *r > least * nearly);
        Self::Log { from: from.unwrap_or(least), to: to.unwrap_or(largest * 10.0), zero }
    }

    /// The place of a value, from 0 to 1. Values outside of the scale have the place of its end.
    pub fn place(&self, value: f64) -> f64 {
        match *self {
            Self::Linear { end } => (value / end).clamp(0.0, 1.0),
            Self::Log { from, to, zero } => {
                let start = if zero { ZERO_LANE } else { 0.0 };
                if value <= 0.0 {
                    return start / 3.0;
                }
                let share = (value / from).ln() / (to / from).ln();
                start + (1.0 - start) * share.clamp(0.0, 1.0)
            }
        }
    }

    /// The marks, at most about ten.
    pub fn ticks(&self, unit: Unit) -> Vec<Tick> {
        let tick = |value: f64| Tick { at: self.place(value), label: unit.text(value) };
        match *self {
            Self::Linear { end } => {
                let step = round_step(end);
                let count = (end / step).round() as u32;
                (0..=count).map(|i| tick(f64::from(i) * step)).collect()
            }
            Self::Log { from, to, zero } => {
                let decades = (to / from).log10();
                let inside = |r: &f64| *r >= from / 1.001 && *r <= to * 1.001;
                let marks: Vec<f64> = if decades < 3.0 {
                    round_numbers((from * to).sqrt()).filter(inside).collect()
                } else {
                    let every = (decades / 9.0) as usize + 1;
                    let first = from.log10().ceil() as i32;
                    let last = to.log10().floor() as i32;
                    (first..=last).step_by(every).map(|e| 10f64.powi(e)).collect()
                };
                zero.then(|| tick(0.0)).into_iter().chain(marks.into_iter().map(tick)).collect()
            }
        }
    }
}

/// 1, 2 and 5 times the powers of ten around a value, rising.
fn round_numbers(value: f64) -> impl Iterator<Item = f64> {
    let power = value.log10().floor() as i32;
    (power - 2..=power + 2).flat_map(|e| [1.0, 2.0, 5.0].map(|f| f * 10f64.powi(e)))
}

/// 1, 2 or 5 times a power of ten, of which three to eight fit into `end`.
fn round_step(end: f64) -> f64 {
    let power = 10f64.powf((end / 4.0).log10().floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| end / (f * power) <= 8.0);
    factor.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers_hold_every_value_and_zero_has_its_own_lane() {
        let scale = Scale::log([0.0, 3e-4, 20.0]);
        let Scale::Log { from, to, zero: true } = scale else { panic!("{scale:?}") };
        assert!((from / 2e-4 - 1.0).abs() < 1e-9 && (to / 20.0 - 1.0).abs() < 1e-9, "{scale:?}");
        assert!(scale.place(0.0) < scale.place(2e-4));
        assert!(scale.place(3e-4) < scale.place(20.0) && scale.place(20.0) <= 1.0);
        let labels: Vec<String> = scale.ticks(Unit::Ratio).into_iter().map(|t| t.label).collect();
        assert_eq!(labels, ["0", "0.001", "0.01", "0.1", "1", "10"]);
    }

    #[test]
    fn a_short_range_is_marked_within_its_decade() {
        let scale = Scale::log([2.1e6, 3.4e6]);
        let labels: Vec<String> =
            scale.ticks(Unit::Nanoseconds).into_iter().map(|t| t.label).collect();
        assert_eq!(labels, ["2 ms", "5 ms"]);
    }

    #[test]
    fn one_value_and_none_at_all_still_make_a_scale() {
        for scale in [Scale::log([1.0]), Scale::log([]), Scale::linear([]), Scale::linear([0.0])] {
            let ticks = scale.ticks(Unit::Count);
            assert!(ticks.len() >= 2, "{scale:?}");
            assert!(ticks.iter().all(|t| (0.0..=1.0).contains(&t.at)), "{scale:?}");
        }
    }

    #[test]
    fn linear_ends_are_round_and_ticks_few() {
        for largest in [0.7, 1.0, 3.3, 47.0, 1234.0, 99_999.0] {
            let scale = Scale::linear([largest]);
            let Scale::Linear { end } = scale else { panic!("{scale:?}") };
            assert!(end >= largest && end <= largest * 1.5, "{largest}: {end}");
            let count = scale.ticks(Unit::Count).len();
            assert!((3..=10).contains(&count), "{largest}: {count}");
        }
    }
}
