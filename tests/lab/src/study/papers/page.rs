//! The page: what its JSON has, Markdown, and HTML that loads nothing.

use serde::Serialize;

use super::DATA;
use super::claims::{Claim, Item, Row};
use super::records::Figures;
use super::rule::Verdict;
use crate::study::harness::document::{Part, html, markdown};
use crate::study::harness::machine::Machine;
use crate::study::harness::table::Table;
use crate::study::harness::{Report, StudyError};

/// The JSON object of `papers --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PapersReport {
    /// The machine that made the page, and that of rows "this run".
    pub machine: Machine,
    /// Whether nothing was measured.
    pub only_records: bool,
    /// Verdicts by paper.
    pub summary: Vec<Summary>,
    /// One sentence for each claim that breaks.
    pub breaks: Vec<String>,
    /// One for each that holds.
    pub holds: Vec<String>,
    /// One for each that nothing decides, with the reason.
    pub not_measured: Vec<String>,
    /// The papers.
    pub papers: Vec<Paper>,
    /// What rows name, with its machine.
    pub sources: Vec<Source>,
}

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

    fn summary(&self) -> Summary {
        let count = |verdict| self.claims().filter(|(_, claim)| claim.verdict == verdict).count();
        let nothing = self.items.iter().filter(|item| item.nothing_to_measure.is_some());
        Summary {
            paper: self.name,
            tables_and_figures: self.items.len(),
            nothing_to_measure: nothing.count(),
            holds: count(Verdict::Holds),
            breaks: count(Verdict::Breaks),
            not_measured: count(Verdict::NotMeasured),
        }
    }
}

/// A line of the summary.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// The paper's short name.
    pub paper: &'static str,
    /// Its tables and figures.
    pub tables_and_figures: usize,
    /// Those of them that have nothing to measure.
    pub nothing_to_measure: usize,
    /// Claims that hold.
    pub holds: usize,
    /// Claims that break.
    pub breaks: usize,
    /// Claims that nothing decides.
    pub not_measured: usize,
}

/// A record, or this run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// Its name in rows.
    pub from: String,
    /// Its machine, commit and command.
    pub machine: String,
}

impl PapersReport {
    /// Judges all claims of all papers.
    pub(super) fn of(
        machine: Machine,
        only_records: bool,
        figures: &Figures,
    ) -> Result<Self, StudyError> {
        let mut papers = Vec::new();
        for paper in &DATA.paper {
            let judge = |item| {
                let sources = |kind, on_gpu| figures.sources(kind, on_gpu);
                DATA.judge(item, sources, |wanted| figures.without_cores(wanted))
            };
            papers.push(Paper {
                name: &paper.name,
                title: &paper.title,
                machine: &paper.machine,
                items: paper.items.iter().map(judge).collect::<Result<_, _>>()?,
            });
        }
        let mut sources: Vec<Source> = Vec::new();
        let named = |from: &str| {
            let rows = papers.iter().flat_map(Paper::claims).flat_map(|(_, claim)| &claim.rows);
            let mut names = rows.filter_map(|row| row.from.as_deref());
            names.any(|name| name.split(", ").any(|name| name == from))
        };
        for (from, machine) in figures.machines() {
            let source = Source { from: from.to_owned(), machine: machine.to_owned() };
            if named(from) && !sources.contains(&source) {
                sources.push(source);
            }
        }
        Ok(Self {
            machine,
            only_records,
            summary: papers.iter().map(Paper::summary).collect(),
            breaks: sentences(&papers, Verdict::Breaks),
            holds: sentences(&papers, Verdict::Holds),
            not_measured: sentences(&papers, Verdict::NotMeasured),
            papers,
            sources,
        })
    }

    /// What the page was made of.
    fn made_of(&self) -> String {
        let Machine { cpu, threads, commit, optimised, .. } = &self.machine;
        if self.only_records {
            return format!("Made of records alone; commit {commit}.");
        }
        let debug = if *optimised { "" } else { " The build is not optimised: times mean little." };
        format!("This run: {cpu}, {threads} threads, commit {commit}.{debug}")
    }
}

impl Report for PapersReport {
    const NAME: &'static str = "papers";

    fn parts(&self) -> Vec<Part> {
        let mut parts = vec![
            Part::heading(1, "The papers, theirs beside ours"),
            Part::text(self.made_of()),
            Part::text(format!("`{}`", self.machine.command)),
            Part::Table(Table::of(&self.summary)),
            Part::text(HOW_TO_READ.join(" ")),
        ];
        for (title, sentences) in [
            ("What breaks", &self.breaks),
            ("What holds", &self.holds),
            ("What is not measured", &self.not_measured),
        ] {
            parts.extend([Part::heading(2, title), Part::List(sentences.clone())]);
        }
        for Paper { name, title, machine, items } in &self.papers {
            let about = Part::text(format!("{title}. Measured on: {machine}."));
            parts.extend([Part::heading(2, *name), about]);
            for Item { place, shows, nothing_to_measure, claims } in items {
                parts.push(Part::heading(3, format!("{place}: {shows}")));
                let nothing = nothing_to_measure.iter();
                parts.extend(nothing.map(|why| Part::text(format!("Nothing to measure: {why}."))));
                for Claim { says, rule, verdict, why, note, rows } in claims {
                    let why = if why.is_empty() { String::new() } else { format!(" Why: {why}.") };
                    let text = format!("**{verdict}**: {says}. Rule: {rule}.{why} {note}");
                    parts.push(Part::text(text.trim_end()));
                    parts.extend((!rows.is_empty()).then(|| Part::Table(row_table(rows))));
                }
            }
        }
        parts.extend([Part::heading(2, "Sources"), Part::Table(Table::of(&self.sources))]);
        parts
    }

    fn files(&self) -> Vec<(String, String)> {
        let parts = self.parts();
        vec![("papers.md".to_owned(), markdown(&parts)), ("papers.html".to_owned(), html(&parts))]
    }
}

/// How the page is to be read, one sentence each.
const HOW_TO_READ: [&str; 3] = [
    "Each claim of a table or figure has a rule, and the rule alone gives the verdict: it holds where \
     all its figures are there and keep the rule, it breaks where one does not, and it is not measured \
     where a figure is missing.",
    "Ours are times of machines of today: a time that is reached says that nothing was lost since, a \
     ratio of two times of one machine says more.",
    "Figures of one claim are of one source: this run where it has as many of them as a record, else \
     the newest record that has most.",
];

fn row_table(rows: &[Row]) -> Table {
    let with_unit = |x: Option<f64>, unit: &str| {
        let text = x.map_or_else(|| "-".to_owned(), figure_text);
        if x.is_none() || unit.is_empty() { text } else { format!("{text} {unit}") }
    };
    let line = |row: &Row| {
        [
            row.what.clone(),
            with_unit(row.paper, &row.unit),
            with_unit(row.ours, &row.unit),
            with_unit(row.ratio, ""),
            row.from.clone().unwrap_or_else(|| "-".to_owned()),
        ]
    };
    Table::of_texts(["", "paper", "ours", "ratio", "from"], rows.iter().map(line))
}

/// Place, claim and the figure that decided, or the reason.
fn sentences(papers: &[Paper], verdict: Verdict) -> Vec<String> {
    let mut found = Vec::new();
    for paper in papers {
        for (item, claim) in paper.claims().filter(|(_, claim)| claim.verdict == verdict) {
            let why = if claim.why.is_empty() { &claim.rule } else { &claim.why };
            found.push(format!("{}, {}: {}; {why}.", paper.name, item.place, claim.says));
        }
    }
    found
}

/// A figure to four digits; whole numbers from a thousand on.
pub(super) fn figure_text(x: f64) -> String {
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
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}
