//! The page as data: papers, their tables and figures, claims, rows.

use serde::Serialize;

use super::records::Sourced;
use super::rule::Rule;
use crate::study::verdict::Verdict;

/// One figure of a paper beside ours.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What is measured: number of objects, cores, the way.
    pub what: String,
    /// The unit of both figures; empty for numbers without one.
    pub unit: &'static str,
    /// The paper's; null where it gives none.
    pub paper: Option<f64>,
    /// Ours; null where it was not measured.
    pub ours: Option<f64>,
    /// Ours over the paper's.
    pub ratio: Option<f64>,
    /// Where ours comes from: a record, this run, or this build, which computes it.
    pub from: Option<String>,
}

impl Row {
    /// A row; [`Question::ask`] says where ours comes from.
    pub fn new(
        what: impl Into<String>,
        unit: &'static str,
        paper: impl Into<Option<f64>>,
        ours: Option<f64>,
    ) -> Self {
        let paper = paper.into();
        let ratio = match (paper, ours) {
            (Some(paper), Some(ours)) if paper != 0.0 => Some(ours / paper),
            _ => None,
        };
        Self { what: what.into(), unit, paper, ours, ratio, from: None }
    }

    /// Where ours is computed by the code that makes the page, on any machine.
    pub fn of_this_build(self) -> Self {
        Self { from: Some("this build".to_owned()), ..self }
    }

    /// Where both figures have a unit but count other things.
    pub fn without_ratio(self) -> Self {
        Self { ratio: None, ..self }
    }
}

/// A claim of a table or figure with its figures and its verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// The claim, paraphrased.
    pub says: &'static str,
    /// What our figures must be for it to hold.
    pub rule: String,
    /// Whether it holds.
    pub verdict: Verdict,
    /// The figure that decided, or why there is none.
    pub why: String,
    /// How ours differs from the paper's: the machine, the scene, what is timed.
    pub note: &'static str,
    /// The figures.
    pub rows: Vec<Row>,
}

/// A claim before its figures are known.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// The claim, paraphrased.
    pub claim: &'static str,
    /// The rule that decides.
    pub rule: Rule,
    /// What is missing where a figure is.
    pub missing: &'a str,
    /// As in [`Claim`].
    pub note: &'static str,
}

impl Question<'_> {
    /// Takes the figures from the source that has most of the rows, of several the first: figures of
    /// two machines never meet in one claim. `rows` gives the rows of a source, or those without ours.
    pub fn ask<'s, T: 's>(
        &self,
        sources: impl IntoIterator<Item = &'s Sourced<T>>,
        rows: impl Fn(Option<&T>) -> Vec<Row>,
    ) -> Claim {
        let measured = |rows: &[Row]| rows.iter().filter(|row| row.ours.is_some()).count();
        let mut best = rows(None);
        for source in sources {
            let mut found = rows(Some(&source.data));
            if measured(&found) > measured(&best) {
                for row in found.iter_mut().filter(|row| row.ours.is_some()) {
                    row.from = Some(source.from.clone());
                }
                best = found;
            }
        }
        self.judge(best)
    }

    /// The claim with figures that come from nowhere but the code.
    pub fn judge(&self, rows: Vec<Row>) -> Claim {
        let (verdict, why) = match self.rule.judge(&rows) {
            (Verdict::Breaks, breaking) => (Verdict::Breaks, self.rule.evidence(&rows, &breaking)),
            (Verdict::NotMeasured, _) => (Verdict::NotMeasured, self.missing.to_owned()),
            (Verdict::Holds, _) => (Verdict::Holds, self.rule.evidence(&rows, &[])),
        };
        let (says, rule, note) = (self.claim, self.rule.to_string(), self.note);
        Claim { says, rule, verdict, why, note, rows }
    }
}

/// A table or a figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Item {
    /// Its number in the paper.
    pub place: &'static str,
    /// What it shows.
    pub shows: &'static str,
    /// Why there is nothing to measure; null where there is.
    pub nothing_to_measure: Option<&'static str>,
    /// What it claims.
    pub claims: Vec<Claim>,
}

impl Item {
    /// A table or figure that can be measured.
    pub const fn new(place: &'static str, shows: &'static str, claims: Vec<Claim>) -> Self {
        Self { place, shows, nothing_to_measure: None, claims }
    }

    /// One that has nothing to measure.
    pub const fn drawing(place: &'static str, shows: &'static str, why: &'static str) -> Self {
        Self { place, shows, nothing_to_measure: Some(why), claims: Vec::new() }
    }
}

/// A drawing of an algorithm, of an architecture or of a pipeline.
pub const A_DRAWING: &str = "a drawing";
/// A picture of a scene.
pub const A_SCENE: &str = "a picture of scenes";

/// A paper.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Paper {
    /// Short name.
    pub name: &'static str,
    /// Authors, title, where it appeared.
    pub title: &'static str,
    /// The machine of its figures.
    pub machine: &'static str,
    /// All its tables and figures, in the order of their numbers, tables first.
    pub items: Vec<Item>,
}

impl Paper {
    /// Claims of all tables and figures.
    pub fn claims(&self) -> impl Iterator<Item = (&Item, &Claim)> {
        self.items.iter().flat_map(|item| item.claims.iter().map(move |claim| (item, claim)))
    }

    /// How many claims have a verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.claims().filter(|(_, claim)| claim.verdict == verdict).count()
    }
}

/// A figure to four digits; whole numbers from a thousand on.
pub fn figure(x: f64) -> String {
    const DIGITS: i32 = 4;
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let before_point = x.abs().log10().floor() as i32 + 1;
    if before_point < -DIGITS {
        return format!("{x:.2e}");
    }
    let decimals = (DIGITS - before_point).max(0) as usize;
    let text = format!("{x:.decimals$}");
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_short() {
        let text = [0.0, 0.27, 29.66, 1.0, 71_452.0, 0.000_031, 1234.5].map(figure);
        assert_eq!(text, ["0", "0.27", "29.66", "1", "71452", "0.000031", "1234"]);
    }

    #[test]
    fn figures_of_a_claim_are_of_one_source_the_first_that_has_most() {
        let source = |from: &str, data: [Option<f64>; 2]| Sourced {
            from: from.to_owned(),
            machine: String::new(),
            gpu_is_software: false,
            data,
        };
        let none = None;
        let sources = [
            source("this run", [Some(9.0), none]),
            source("new", [Some(1.0), Some(2.0)]),
            source("old", [Some(3.0), Some(4.0)]),
        ];
        let question = Question { claim: "c", rule: Rule::NoMore, missing: "no machine", note: "" };
        let rows = |data: Option<&[Option<f64>; 2]>| {
            let ours = |i: usize| data.and_then(|data| data[i]);
            vec![Row::new("a", "", 2.0, ours(0)), Row::new("b", "", 2.0, ours(1))]
        };
        let claim = question.ask(&sources, rows);
        assert_eq!(claim.verdict, Verdict::Holds);
        assert!(claim.rows.iter().all(|row| row.from.as_deref() == Some("new")), "{claim:?}");
        let claim = question.ask(&sources[..0], rows);
        assert_eq!((claim.verdict, claim.why.as_str()), (Verdict::NotMeasured, "no machine"));
    }
}
