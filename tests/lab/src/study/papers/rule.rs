//! Rules by which a claim holds or breaks: pure functions over figures.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::claims::Row;
use super::page::figure_text;

/// Part of the paper's figure by which ours may fall short: medians of two runs differ by as much.
const SLACK: f64 = 0.1;
/// Part by which a next figure must be lower to count as lower: timing noise is below it.
const NOISE: f64 = 0.05;

/// Whether a claim holds here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All its figures are there, and it holds in all of them.
    Holds,
    Breaks,
    /// A figure is missing, and it fails in none of the others.
    NotMeasured,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Holds => "holds",
            Self::Breaks => "breaks",
            Self::NotMeasured => "not measured",
        })
    }
}

/// What our figures must be, given the paper's. A figure here is a row of the claim.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
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
    AtMost(f64),
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
        let smallest = rows.iter().filter_map(|row| row.ours).fold(f64::INFINITY, f64::min);
        let breaking: Vec<&Row> = match self {
            Self::Rises => next_ones(rows, |before, ours| ours > before),
            Self::Falls => next_ones(rows, |before, ours| ours < before * (1.0 - NOISE)),
            Self::IsConstant => {
                let is_beyond = |ours| ours > smallest * (1.0 + SLACK);
                rows.iter().filter(|row| row.ours.is_some_and(is_beyond)).collect()
            }
            _ => rows.iter().filter(|row| self.keeps(row) == Some(false)).collect(),
        };
        let verdict = if !breaking.is_empty() {
            Verdict::Breaks
        } else if rows.is_empty() || rows.iter().any(|row| row.ours.is_none()) {
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
            if other < before {
                text = format!("{}; {text}", in_words(&rows[other]));
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
        Some(match self {
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
        })
    }
}

/// Rows that do not follow on the measured one before.
fn next_ones(rows: &[Row], follows: impl Fn(f64, f64) -> bool) -> Vec<&Row> {
    let measured: Vec<(&Row, f64)> =
        rows.iter().filter_map(|row| row.ours.map(|ours| (row, ours))).collect();
    let breaks = |pair: &&[(&Row, f64)]| !follows(pair[0].1, pair[1].1);
    measured.windows(2).filter(breaks).map(|pair| pair[1].0).collect()
}

fn in_words(row: &Row) -> String {
    let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
    let ours = row.ours.map_or_else(|| "no figure".to_owned(), figure_text);
    let paper =
        row.paper.map_or_else(String::new, |paper| format!(", the paper's {}", figure_text(paper)));
    format!("{}: ours {ours}{unit}{paper}", row.what)
}
