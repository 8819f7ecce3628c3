//! Rules by which a claim holds or breaks: conditions over a row's figures, written in the table of claims.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::claims::Row;
use super::expression::{Scope, filled_in};
use crate::study::harness::number_text;

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

/// What our figures must be, given the paper's: in words, and as conditions that each row has to keep. Conditions are
/// over `ours`, `paper`, `before` (ours of the measured row before) and `least` (of ours in all rows); one that lacks
/// a figure breaks nothing.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    pub says: String,
    keeps: Vec<String>,
}

impl Rule {
    /// The rule that a claim names: its name, or that and its bounds, which stand for `@1` and `@2`.
    pub fn named(text: &str, rules: &BTreeMap<String, Self>) -> Result<Self, String> {
        let (name, bounds) = text.split_once('(').unwrap_or((text, ""));
        let mut rule = rules.get(name).ok_or_else(|| format!("'{text}' is no rule"))?.clone();
        let fill = |text: &str| filled_in(text, bounds.trim_end_matches(')'));
        rule.says = fill(&rule.says);
        rule.keeps.iter_mut().for_each(|condition| *condition = fill(condition));
        Ok(rule)
    }

    pub fn judge<'a>(&self, rows: &'a [Row]) -> Result<(Verdict, Vec<&'a Row>), String> {
        let mut figures = Map::new();
        let least = rows.iter().filter_map(|row| row.ours).reduce(f64::min);
        figures.insert("least".to_owned(), json!(least));
        let mut root = Value::Object(figures);
        let mut breaking = Vec::new();
        for row in rows {
            root["ours"] = json!(row.ours);
            root["paper"] = json!(row.paper);
            let scope = Scope { root: &root, defined: &BTreeMap::new() };
            for condition in &self.keeps {
                if scope.value(condition)? == Some(0.0) {
                    breaking.push(row);
                    break;
                }
            }
            if row.ours.is_some() {
                root["before"] = json!(row.ours);
            }
        }
        let verdict = if !breaking.is_empty() {
            Verdict::Breaks
        } else if rows.is_empty() || rows.iter().any(|row| row.ours.is_none()) {
            Verdict::NotMeasured
        } else {
            Verdict::Holds
        };
        Ok((verdict, breaking))
    }

    pub fn evidence(&self, rows: &[Row], breaking: &[&Row]) -> String {
        let Some(row) = breaking.first().copied().or(rows.last()) else { return String::new() };
        let mut text = in_words(row);
        if self.keeps.iter().any(|condition| condition.contains("before")) {
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
}

fn in_words(row: &Row) -> String {
    let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
    let ours = row.ours.map_or_else(|| "no figure".to_owned(), number_text);
    let paper =
        row.paper.map_or_else(String::new, |paper| format!(", the paper's {}", number_text(paper)));
    format!("{}: ours {ours}{unit}{paper}", row.what)
}
