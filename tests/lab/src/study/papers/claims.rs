//! The table of claims as it is written, and its evaluation.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::expression::{Scope, select};
use super::records::{Figures, Source};
use super::rule::{Rule, Verdict};

/// `data/papers.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    figures: Value,
    text: BTreeMap<String, String>,
    define: BTreeMap<String, String>,
    pub rules: BTreeMap<String, Rule>,
    lists: BTreeMap<String, Vec<Value>>,
    pub paper: Vec<PaperData>,
    pub mapping: Vec<ItemData>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperData {
    pub name: String,
    pub title: String,
    pub machine: String,
    pub entries: Vec<ItemData>,
}

#[derive(Debug, Deserialize)]
pub struct ItemData {
    pub label: String,
    #[serde(default)]
    pub shows: String,
    pub nothing_to_measure: Option<String>,
    #[serde(default)]
    claims: Vec<Map<String, Value>>,
    /// What holds for all claims that do not say otherwise.
    #[serde(flatten)]
    defaults: Map<String, Value>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Mapping,
    Grid,
    Threads,
    Spheres,
    TwoGpus,
    /// `threads.json` with a `grid` of the same machine.
    GridAndThreads,
    /// The code that makes the page, on any machine.
    Build,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Measured {
    Some,
    Last,
}

/// The rows of a claim are times of this scene on so many cores, where none says what is missing.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MissingCores {
    pub scene: String,
    pub n: u64,
    pub cores: u64,
}

/// A claim as it is written. The module documentation of `papers` says what the fields mean.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ClaimData {
    says: String,
    rule: String,
    of: Option<Kind>,
    #[serde(default)]
    on_gpu: bool,
    #[serde(default)]
    missing: String,
    missing_cores: Option<MissingCores>,
    #[serde(default)]
    note: String,
    each: Option<Value>,
    all: Option<String>,
    measured: Option<Measured>,
    #[serde(default)]
    what: String,
    #[serde(default)]
    what_else: String,
    #[serde(default)]
    unit: String,
    #[serde(default)]
    counts_other_units: bool,
    paper: Option<Value>,
    #[serde(default)]
    ours: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    pub what: String,
    pub unit: String,
    pub paper: Option<f64>,
    pub ours: Option<f64>,
    pub ratio: Option<f64>,
    pub from: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    pub says: String,
    pub rule: String,
    pub verdict: Verdict,
    pub why: String,
    pub note: String,
    pub rows: Vec<Row>,
}

impl Data {
    pub fn paper_figure(&self, expression: &str) -> Result<Option<f64>, String> {
        Scope { root: &self.figures, defined: &self.define }.value(expression)
    }

    pub fn judge(&self, entry: &ItemData, figures: &Figures) -> Result<Vec<Claim>, String> {
        let claim = |fields: &Map<String, Value>| {
            let mut all = entry.defaults.clone();
            all.extend(fields.clone());
            let data = serde_json::from_value(Value::Object(all));
            self.claim(&data.map_err(|error| format!("{}: {error}", entry.label))?, figures)
        };
        entry.claims.iter().map(claim).collect()
    }

    /// Takes the figures from the source that has most of the rows, of several the first: figures of
    /// two machines never meet in one claim.
    fn claim(&self, data: &ClaimData, figures: &Figures) -> Result<Claim, String> {
        let measured = |rows: &[Row]| rows.iter().filter(|row| row.ours.is_some()).count();
        let mut best = self.rows(data, None)?;
        for source in figures.sources(data.of, data.on_gpu) {
            let found = self.rows(data, Some(source))?;
            if measured(&found) > measured(&best) {
                best = found;
            }
        }
        // A text, or that of `[text]` which it names.
        let text = |text: &str| {
            let named = text.strip_prefix('$').and_then(|name| self.text.get(name));
            named.map_or(text, String::as_str).to_owned()
        };
        let rule = Rule::named(&data.rule, &self.rules)?;
        let (verdict, breaking) = rule.judge(&best)?;
        let why = match (verdict, &data.missing_cores) {
            (Verdict::NotMeasured, Some(cores)) => figures.without_cores(cores),
            (Verdict::NotMeasured, None) => text(&data.missing),
            (Verdict::Breaks | Verdict::Holds, _) => rule.evidence(&best, &breaking),
        };
        let (says, rule) = (data.says.clone(), rule.says);
        Ok(Claim { says, rule, verdict, why, note: text(&data.note), rows: best })
    }

    /// The rows of a claim with the figures of a source, or without any of ours.
    fn rows(&self, data: &ClaimData, source: Option<&Source>) -> Result<Vec<Row>, String> {
        let root = source.map_or(&Value::Null, |source| &source.data);
        let mut rows: Vec<Row> = if let Some(all) = &data.all {
            let selected = select(root, all).into_iter();
            selected.map(|row| self.row(data, source, row, row)).collect::<Result<_, _>>()?
        } else {
            let each = match &data.each {
                Some(Value::String(name)) => {
                    self.lists.get(name).ok_or_else(|| format!("no list `{name}`"))?.as_slice()
                }
                Some(Value::Array(each)) => each,
                _ if data.what.is_empty() => &[],
                _ => &[Value::Null],
            };
            let rows = each.iter().map(|element| self.row(data, source, element, root));
            rows.collect::<Result<_, _>>()?
        };
        if data.all.is_some() && rows.is_empty() {
            rows.push(self.row(data, None, &Value::Null, root)?);
        }
        match data.measured {
            None => {}
            Some(Measured::Some) => rows.retain(|row| row.ours.is_some()),
            Some(Measured::Last) => {
                let last = rows.iter().rposition(|row| row.ours.is_some());
                rows = rows.split_off(last.unwrap_or(rows.len().saturating_sub(1)));
                rows.truncate(1);
            }
        }
        Ok(rows)
    }

    fn row(
        &self,
        data: &ClaimData,
        source: Option<&Source>,
        element: &Value,
        root: &Value,
    ) -> Result<Row, String> {
        let whole = source.map_or(&Value::Null, |source| &source.data);
        // `{x}` and `{name}` are replaced; nothing stands for a name that nobody has.
        let fill = |text: &str| {
            let mut parts = text.split('{');
            let mut out = parts.next().unwrap_or_default().to_owned();
            for (name, rest) in parts.filter_map(|part| part.split_once('}')) {
                let found = if name == "x" { Some(element) } else { element.get(name) };
                match found.or_else(|| whole.get(name)) {
                    Some(Value::String(text)) => out.push_str(text),
                    Some(Value::Number(number)) => out += &number.to_string(),
                    _ => {}
                }
                out.push_str(rest);
            }
            out
        };
        let paper = match &data.paper {
            Some(Value::String(text)) => self.paper_figure(&fill(text))?,
            number => number.as_ref().and_then(Value::as_f64),
        };
        let ours = if source.is_none() || data.ours.is_empty() {
            None
        } else {
            Scope { root, defined: &self.define }.value(&fill(&data.ours))?
        };
        let comparable = paper.filter(|paper| *paper != 0.0 && !data.counts_other_units);
        let ratio = ours.zip(comparable).map(|(ours, paper)| ours / paper);
        let is_else = source.is_none() && data.all.is_some();
        let what = if is_else { data.what_else.clone() } else { fill(&data.what) };
        let from = ours.and(source).map(|source| source.from.clone());
        Ok(Row { what, unit: data.unit.clone(), paper, ours, ratio, from })
    }
}
