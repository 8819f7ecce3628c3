//! `--assert 'missed=0,p99<2ms'`: limits that rows have to keep.

use std::fmt;
use std::str::FromStr;

use super::mode::PLAIN_F32;
use super::rows::AccuracyRow;

/// A figure of a row that can be limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Missed pairs.
    Missed,
    /// Extra pairs.
    Extra,
    /// Extra pairs for each exact pair; infinite where there is no exact pair to compare with.
    ExtraRatio,
    /// Median of a whole frame, ns.
    P50,
    /// 99th percentile of a whole frame, ns.
    P99,
    /// Bytes of the boxes of a request.
    BytesUp,
    /// Bytes of the mask of a request.
    BytesDown,
    /// Resident memory, bytes.
    Memory,
}

impl Figure {
    const ALL: [(Self, &str); 8] = [
        (Self::Missed, "missed"),
        (Self::Extra, "extra"),
        (Self::ExtraRatio, "extra_ratio"),
        (Self::P50, "p50"),
        (Self::P99, "p99"),
        (Self::BytesUp, "bytes_up"),
        (Self::BytesDown, "bytes_down"),
        (Self::Memory, "memory"),
    ];

    fn of(self, row: &AccuracyRow) -> f64 {
        match self {
            Self::Missed => row.missed as f64,
            Self::Extra => row.extra as f64,
            Self::ExtraRatio => row.extra_ratio.unwrap_or(f64::INFINITY),
            Self::P50 => row.times.total_ns.p50 as f64,
            Self::P99 => row.times.total_ns.p99 as f64,
            Self::BytesUp => row.bytes_up as f64,
            Self::BytesDown => row.bytes_down as f64,
            Self::Memory => row.memory_bytes as f64,
        }
    }
}

/// How a figure is limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Relation {
    Equal,
    AtMost,
    Below,
}

/// Limits, all of which every row has to keep.
#[derive(Clone, Debug, PartialEq)]
pub struct Assertion(Vec<Limit>);

#[derive(Clone, Debug, PartialEq)]
struct Limit {
    figure: Figure,
    relation: Relation,
    value: f64,
    text: String,
}

/// Why a limit is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' is no limit: write FIGURE=X, FIGURE<X or FIGURE<=X; figures are missed, extra, extra_ratio, p50, p99, bytes_up, bytes_down, memory; X may end in ns, us, ms, s, %, KiB, MiB or GiB"
)]
pub struct BadLimit(String);

/// Suffixes of a value, and their factors.
const UNITS: [(&str, f64); 8] = [
    ("ns", 1.0),
    ("us", 1e3),
    ("ms", 1e6),
    ("KiB", 1024.0),
    ("MiB", 1_048_576.0),
    ("GiB", 1_073_741_824.0),
    ("%", 0.01),
    ("s", 1e9),
];

fn value(text: &str) -> Option<f64> {
    let with_unit =
        UNITS.iter().find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, factor)));
    let (number, factor) = with_unit.unwrap_or((text, &1.0));
    let value = number.trim().parse::<f64>().ok()? * factor;
    (!value.is_nan()).then_some(value)
}

impl FromStr for Assertion {
    type Err = BadLimit;

    fn from_str(s: &str) -> Result<Self, BadLimit> {
        let limit = |text: &str| {
            let relations =
                [("<=", Relation::AtMost), ("<", Relation::Below), ("=", Relation::Equal)];
            let (name, relation, number) = relations
                .into_iter()
                .find_map(|(sign, relation)| Some((text.split_once(sign)?, relation)))
                .map(|((name, number), relation)| (name.trim(), relation, number.trim()))?;
            let (figure, _) = Figure::ALL.into_iter().find(|(_, known)| *known == name)?;
            Some(Limit { figure, relation, value: value(number)?, text: text.trim().to_owned() })
        };
        let limits = s.split(',').map(|text| limit(text).ok_or_else(|| BadLimit(text.to_owned())));
        limits.collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for Assertion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, limit) in self.0.iter().enumerate() {
            write!(f, "{}{}", if i == 0 { "" } else { "," }, limit.text)?;
        }
        Ok(())
    }
}

impl Assertion {
    /// One line for each limit that a row does not keep. Rows of which no frame was checked keep no
    /// limit on pairs. Rows of plain rounding to f32, which stand there as a warning, are not
    /// limited.
    pub fn failures(&self, rows: &[AccuracyRow]) -> Vec<String> {
        let mut failures = Vec::new();
        for row in rows.iter().filter(|row| row.mode != PLAIN_F32) {
            for limit in &self.0 {
                let found = limit.figure.of(row);
                let is_kept = match limit.relation {
                    Relation::Equal => found == limit.value,
                    Relation::AtMost => found <= limit.value,
                    Relation::Below => found < limit.value,
                };
                let about_pairs =
                    matches!(limit.figure, Figure::Missed | Figure::Extra | Figure::ExtraRatio);
                if about_pairs && row.checked_frames == 0 {
                    failures.push(format!("{}: {} was not checked", row.name(), limit.text));
                } else if !is_kept {
                    failures.push(format!("{}: {} is {found}", row.name(), limit.text));
                }
            }
        }
        failures
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::*;

    fn failures(limits: &str) -> usize {
        let assertion: Assertion = limits.parse().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(assertion.to_string(), limits);
        assertion.failures(&[row()]).len()
    }

    #[test]
    fn limits_hold_or_do_not() {
        assert_eq!(failures("missed=0,p99<2ms"), 0);
        assert_eq!(failures("missed=0,p99<1ms,extra_ratio<=2.5%"), 1);
        assert_eq!(failures("extra_ratio<2.5%"), 1);
        assert_eq!(failures("extra=0"), 1);
        assert_eq!(failures("memory<=1GiB,bytes_up<24001,p50<0.6ms"), 0);
        let plain = AccuracyRow { mode: PLAIN_F32.to_owned(), missed: 1, ..row() };
        let missed: Assertion = "missed=0".parse().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(
            missed.failures(std::slice::from_ref(&plain)).len(),
            0,
            "a warning has no limits"
        );
        let named = AccuracyRow { mode: "f64".to_owned(), ..plain };
        assert_eq!(missed.failures(&[named]).len(), 1);
        let unchecked = AccuracyRow { checked_frames: 0, ..row() };
        assert_eq!(missed.failures(&[unchecked]).len(), 1, "nothing looked at proves nothing");
    }

    #[test]
    fn what_is_no_limit_is_said() {
        for wrong in ["", "missed", "missed=", "speed<1", "p99<2 hours", "p99>1", "p99<nan"] {
            assert!(wrong.parse::<Assertion>().is_err(), "{wrong}");
        }
    }
}
