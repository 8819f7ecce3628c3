//! Rules by which a claim holds or breaks: pure functions over figures.

use std::fmt;

use super::model::{Row, figure};
use crate::study::verdict::Verdict;

/// Part of the paper's figure by which ours may fall short: medians of two runs differ by as much.
const SLACK: f64 = 0.1;
/// Part by which a next figure must be lower to count as lower: timing noise is below it.
const NOISE: f64 = 0.05;

/// What our figures must be, given the paper's. A figure here is a row of the claim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Ours is at most the paper's.
    NoMore,
    /// Ours is at least the paper's, but for [`SLACK`].
    Reaches,
    /// Ours is at most the paper's, but for [`SLACK`].
    Within,
    /// Ours, rounded to a whole number, is at least the paper's whole number.
    RoundsTo,
    /// Ours is the paper's, whole numbers both.
    Equals,
    /// Ours is the paper's, but for [`SLACK`] more or less.
    SameShare,
    /// Ours and the paper's are on the same side of a value.
    SameSide(f64),
    /// Ours is at most a bound.
    AtMost(f64),
    /// Ours is at least a bound.
    AtLeast(f64),
    /// Ours is more than the first and less than the second bound.
    Between(f64, f64),
    /// Each of ours is more than the one before.
    Rises,
    /// Each of ours is less than the one before, by more than [`NOISE`].
    Falls,
    /// The largest of ours exceeds the smallest by at most [`SLACK`].
    IsConstant,
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (slack, noise) = (100.0 * SLACK, 100.0 * NOISE);
        match self {
            Self::NoMore => f.write_str("ours is at most the paper's"),
            Self::Reaches => write!(f, "ours is at least the paper's, less {slack} %"),
            Self::Within => write!(f, "ours is at most the paper's and {slack} %"),
            Self::RoundsTo => {
                f.write_str("ours, rounded as the paper's is, is at least the paper's")
            }
            Self::Equals => f.write_str("ours is the paper's"),
            Self::SameShare => write!(f, "ours is the paper's, {slack} % more or less"),
            Self::SameSide(x) => write!(f, "ours is on the paper's side of {x}"),
            Self::AtMost(x) => write!(f, "ours is at most {x}"),
            Self::AtLeast(x) => write!(f, "ours is at least {x}"),
            Self::Between(low, high) => write!(f, "ours is between {low} and {high}"),
            Self::Rises => f.write_str("each of ours is more than the one before"),
            Self::Falls => {
                write!(f, "each of ours is less than the one before, by more than {noise} %")
            }
            Self::IsConstant => {
                write!(f, "the largest of ours is at most {slack} % above the smallest")
            }
        }
    }
}

impl Rule {
    /// The verdict over the rows, and the rows that break the rule.
    pub fn judge(self, rows: &[Row]) -> (Verdict, Vec<&Row>) {
        let breaking: Vec<&Row> = match self {
            Self::Rises => next_ones(rows, |before, ours| ours > before),
            Self::Falls => next_ones(rows, |before, ours| ours < before * (1.0 - NOISE)),
            Self::IsConstant => beyond(rows),
            _ => rows.iter().filter(|row| self.keeps(row) == Some(false)).collect(),
        };
        let is_missing = |row: &Row| row.ours.is_none();
        let verdict = if !breaking.is_empty() {
            Verdict::Breaks
        } else if rows.is_empty() || rows.iter().any(is_missing) {
            Verdict::NotMeasured
        } else {
            Verdict::Holds
        };
        (verdict, breaking)
    }

    /// The figures that decided, in words: of a broken rule the first row that breaks it, else the last.
    pub fn evidence(self, rows: &[Row], breaking: &[&Row]) -> String {
        let Some(row) = breaking.first().copied().or(rows.last()) else { return String::new() };
        let mut text = in_words(row);
        if matches!(self, Self::Rises | Self::Falls) {
            // Of a broken rule the row before, else the first.
            let before = rows.iter().position(|other| other == row).unwrap_or(0);
            let other = if breaking.is_empty() { 0 } else { before.saturating_sub(1) };
            let other = (other < before).then(|| &rows[other]);
            if let Some(other) = other {
                text = format!("{}; {text}", in_words(other));
            }
        }
        match breaking.len() {
            0 | 1 => text,
            more => format!("{text}; and {} more", more - 1),
        }
    }

    /// Whether one row keeps the rule; `None` where a figure is missing.
    fn keeps(self, row: &Row) -> Option<bool> {
        let ours = row.ours?;
        let kept = match self {
            Self::NoMore => ours <= row.paper?,
            Self::Reaches => ours >= row.paper? * (1.0 - SLACK),
            Self::Within => ours <= row.paper? * (1.0 + SLACK),
            Self::RoundsTo => ours.round() >= row.paper?,
            // Whole numbers, which f64 holds exactly.
            Self::Equals => (ours - row.paper?).abs() < 0.5,
            Self::SameShare => (ours - row.paper?).abs() <= SLACK * row.paper?,
            Self::SameSide(x) => (ours > x) == (row.paper? > x),
            Self::AtMost(x) => ours <= x,
            Self::AtLeast(x) => ours >= x,
            Self::Between(low, high) => low < ours && ours < high,
            Self::Rises | Self::Falls | Self::IsConstant => true,
        };
        Some(kept)
    }
}

/// Rows that do not follow on the measured one before.
fn next_ones(rows: &[Row], follows: impl Fn(f64, f64) -> bool) -> Vec<&Row> {
    let measured: Vec<(&Row, f64)> =
        rows.iter().filter_map(|row| row.ours.map(|ours| (row, ours))).collect();
    let breaks = |pair: &&[(&Row, f64)]| !follows(pair[0].1, pair[1].1);
    measured.windows(2).filter(breaks).map(|pair| pair[1].0).collect()
}

/// Rows too far above the smallest.
fn beyond(rows: &[Row]) -> Vec<&Row> {
    let smallest = rows.iter().filter_map(|row| row.ours).fold(f64::INFINITY, f64::min);
    let most = smallest * (1.0 + SLACK);
    rows.iter().filter(|row| row.ours.is_some_and(|ours| ours > most)).collect()
}

/// A row's figures in words.
fn in_words(row: &Row) -> String {
    let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
    let ours = row.ours.map_or_else(|| "no figure".to_owned(), figure);
    match row.paper {
        Some(paper) => format!("{}: ours {ours}{unit}, the paper's {}", row.what, figure(paper)),
        None => format!("{}: ours {ours}{unit}", row.what),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's figure and ours, of two rows.
    type Two = [(f64, f64); 2];

    fn rows(figures: &[(f64, f64)]) -> Vec<Row> {
        figures.iter().map(|(paper, ours)| Row::new("x", "ms", *paper, Some(*ours))).collect()
    }

    #[test]
    fn every_rule_can_hold_and_can_break() {
        let cases: [(Rule, Two, Two); 13] = [
            (Rule::NoMore, [(2.0, 1.0), (2.0, 2.0)], [(2.0, 1.0), (2.0, 2.1)]),
            (Rule::Reaches, [(2.0, 1.8), (2.0, 9.0)], [(2.0, 9.0), (2.0, 1.7)]),
            (Rule::Within, [(50.0, 54.0), (50.0, 1.0)], [(50.0, 1.0), (50.0, 56.0)]),
            (Rule::RoundsTo, [(2.0, 1.5), (3.0, 2.6)], [(2.0, 1.5), (3.0, 2.4)]),
            (Rule::Equals, [(7.0, 7.0), (8.0, 8.0)], [(7.0, 7.0), (8.0, 7.0)]),
            (Rule::SameShare, [(1.0, 1.09), (1.0, 0.91)], [(1.0, 1.0), (1.0, 0.8)]),
            (Rule::SameSide(1.0), [(0.6, 0.1), (1.2, 2.0)], [(0.6, 0.1), (1.2, 0.9)]),
            (Rule::AtMost(0.0), [(0.0, 0.0), (0.0, 0.0)], [(0.0, 0.0), (0.0, 1.0)]),
            (Rule::AtLeast(5.0), [(8.0, 5.0), (8.0, 6.0)], [(8.0, 5.0), (8.0, 4.9)]),
            (Rule::Between(1.0, 2.0), [(1.0, 1.1), (1.0, 1.9)], [(1.0, 1.1), (1.0, 2.0)]),
            (Rule::Rises, [(1.0, 1.0), (1.0, 1.1)], [(1.0, 1.0), (1.0, 1.0)]),
            (Rule::Falls, [(1.0, 1.0), (1.0, 0.9)], [(1.0, 1.0), (1.0, 0.99)]),
            (Rule::IsConstant, [(1.0, 1.0), (1.0, 1.09)], [(1.0, 1.0), (1.0, 1.2)]),
        ];
        for (rule, kept, broken) in cases {
            let (kept, broken) = (rows(&kept), rows(&broken));
            assert_eq!(rule.judge(&kept), (Verdict::Holds, Vec::new()), "{rule}");
            assert_eq!(rule.judge(&broken), (Verdict::Breaks, vec![&broken[1]]), "{rule}");
        }
    }

    #[test]
    fn the_evidence_is_what_decided() {
        let named = |figures: &[f64]| -> Vec<Row> {
            let row = |(i, ours): (usize, &f64)| Row::new(format!("r{i}"), "s", None, Some(*ours));
            figures.iter().enumerate().map(row).collect()
        };
        let evidence = |rule: Rule, rows: &[Row]| rule.evidence(rows, &rule.judge(rows).1);
        let rows = named(&[1.0, 2.0, 2.0, 1.0]);
        assert_eq!(evidence(Rule::Rises, &rows), "r1: ours 2 s; r2: ours 2 s; and 1 more");
        assert_eq!(evidence(Rule::Rises, &rows[..2]), "r0: ours 1 s; r1: ours 2 s");
        assert_eq!(evidence(Rule::AtMost(1.0), &rows[..2]), "r1: ours 2 s");
        assert_eq!(evidence(Rule::AtMost(1.0), &[]), "");
    }

    #[test]
    fn a_missing_figure_hides_no_break_and_never_holds() {
        let mut some = rows(&[(2.0, 1.0)]);
        some.push(Row::new("y", "ms", 2.0, None));
        assert_eq!(Rule::NoMore.judge(&some).0, Verdict::NotMeasured);
        some.extend(rows(&[(2.0, 3.0)]));
        assert_eq!(Rule::NoMore.judge(&some).0, Verdict::Breaks);
        assert_eq!(Rule::Rises.judge(&[]).0, Verdict::NotMeasured);
        let theirs_missing = [Row::new("z", "ms", None, Some(1.0))];
        assert_eq!(Rule::Reaches.judge(&theirs_missing).0, Verdict::Holds);
    }
}
