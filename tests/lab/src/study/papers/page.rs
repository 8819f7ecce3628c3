//! The page: what its JSON has, Markdown, and HTML that loads nothing.

use serde::Serialize;
use serde_json::json;

use super::DATA;
use super::claims::{Claim, ItemData, PaperData, Row};
use super::records::{Figures, Source};
use super::rule::Verdict;
use crate::Result;
use crate::study::harness::{Fields, Part, Report, Table, number_text, row};

#[derive(Clone, Debug, PartialEq)]
pub struct PapersReport {
    machine: Fields,
    only_records: bool,
    pub papers: Vec<Paper>,
    pub sources: Vec<Source>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Paper {
    pub name: &'static str,
    pub title: &'static str,
    pub machine: &'static str,
    pub entries: Vec<Item>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Item {
    pub label: &'static str,
    pub shows: &'static str,
    pub nothing_to_measure: &'static Option<String>,
    pub claims: Vec<Claim>,
}

impl Paper {
    pub fn claims(&self) -> impl Iterator<Item = (&Item, &Claim)> {
        self.entries.iter().flat_map(|entry| entry.claims.iter().map(move |claim| (entry, claim)))
    }

    fn summary(&self) -> Fields {
        let count = |verdict| self.claims().filter(|(_, claim)| claim.verdict == verdict).count();
        let nothing = self.entries.iter().filter(|entry| entry.nothing_to_measure.is_some());
        row!(
            paper: self.name,
            tables_and_figures: self.entries.len(),
            nothing_to_measure: nothing.count(),
            holds: count(Verdict::Holds),
            breaks: count(Verdict::Breaks),
            not_measured: count(Verdict::NotMeasured),
        )
    }
}

impl PapersReport {
    pub fn of(machine: Fields, only_records: bool, figures: &Figures) -> Result<Self> {
        let mut papers = Vec::new();
        for PaperData { name, title, machine, entries } in &DATA.paper {
            let judge = |entry: &'static ItemData| {
                let ItemData { label, shows, nothing_to_measure, .. } = entry;
                let claims = DATA.judge(entry, figures)?;
                Ok(Item { label, shows, nothing_to_measure, claims })
            };
            let entries = entries.iter().map(judge).collect::<Result<_, String>>()?;
            papers.push(Paper { name, title, machine, entries });
        }
        let named = |source: &&Source| {
            let rows = papers.iter().flat_map(Paper::claims).flat_map(|(_, claim)| &claim.rows);
            let mut names = rows.filter_map(|row| row.from.as_deref());
            names.any(|name| name.split(", ").any(|name| name == source.from))
        };
        let mut sources: Vec<Source> = Vec::new();
        for Source { from, machine, .. } in figures.all_sources().filter(named) {
            let source =
                Source { from: from.clone(), machine: machine.clone(), ..Source::default() };
            if !sources.contains(&source) {
                sources.push(source);
            }
        }
        Ok(Self { machine, only_records, papers, sources })
    }

    pub fn summary(&self) -> Vec<Fields> {
        self.papers.iter().map(Paper::summary).collect()
    }

    /// As it is printed and written.
    pub fn report(&self) -> Report {
        let made_of = if self.only_records { "Made of records alone, by:" } else { "This run:" };
        let title = Part::heading(1, "The papers, theirs beside ours");
        let mut report = Report::new("papers", vec![title, Part::text(made_of)]);
        report.page = Some(("papers.html", Vec::new()));
        let lines = self.papers.iter().flat_map(Paper::claims).flat_map(|(entry, claim)| {
            let line = |row| json!({ "label": entry.label, "says": claim.says, "row": row });
            claim.rows.iter().map(line)
        });
        report.csv_rows = Some(Table::of(&lines.collect::<Vec<_>>()));
        report.machine(self.machine.clone());
        report.value("only_records", self.only_records);
        let summary = self.summary();
        report.parts.push(Part::Table(Table::of(&summary)));
        report.list("summary", &summary);
        report.parts.push(Part::text(HOW_TO_READ.join(" ")));
        for (name, title, verdict) in [
            ("breaks", "What breaks", Verdict::Breaks),
            ("holds", "What holds", Verdict::Holds),
            ("not_measured", "What is not measured", Verdict::NotMeasured),
        ] {
            let sentences = self.sentences(verdict);
            report.value(name, &sentences);
            report.parts.extend([Part::heading(2, title), Part::List(sentences)]);
        }
        report.value("papers", &self.papers);
        let with_unit = |x: Option<f64>, unit: &str| {
            x.map_or("-".to_owned(), |x| format!("{} {unit}", number_text(x)).trim_end().to_owned())
        };
        let cells = |row: &Row| {
            [
                row.what.clone(),
                with_unit(row.paper, &row.unit),
                with_unit(row.ours, &row.unit),
                with_unit(row.ratio, ""),
                row.from.clone().unwrap_or_else(|| "-".to_owned()),
            ]
        };
        let parts = &mut report.parts;
        for Paper { name, title, machine, entries } in &self.papers {
            let about = Part::text(format!("{title}. Measured on: {machine}."));
            parts.extend([Part::heading(2, *name), about]);
            for Item { label, shows, nothing_to_measure, claims } in entries {
                parts.push(Part::heading(3, format!("{label}: {shows}")));
                let nothing = nothing_to_measure.iter();
                parts.extend(nothing.map(|why| Part::text(format!("Nothing to measure: {why}."))));
                for Claim { says, rule, verdict, why, note, rows } in claims {
                    let why = if why.is_empty() { String::new() } else { format!(" Why: {why}.") };
                    let text = format!("**{verdict}**: {says}. Rule: {rule}.{why} {note}");
                    parts.push(Part::text(text.trim_end()));
                    let table = Table::of_texts(
                        ["", "paper", "ours", "ratio", "from"],
                        rows.iter().map(cells),
                    );
                    parts.extend((!rows.is_empty()).then_some(Part::Table(table)));
                }
            }
        }
        parts.extend([Part::heading(2, "Sources"), Part::Table(Table::of(&self.sources))]);
        report.list("sources", &self.sources);
        report
    }

    /// A sentence for each claim of a verdict.
    pub fn sentences(&self, verdict: Verdict) -> Vec<String> {
        let of = |paper: &Paper| {
            let claims = paper.claims().filter(|(_, claim)| claim.verdict == verdict);
            let sentence = |(entry, claim): (&Item, &Claim)| {
                let why = if claim.why.is_empty() { &claim.rule } else { &claim.why };
                format!("{}, {}: {}; {why}.", paper.name, entry.label, claim.says)
            };
            claims.map(sentence).collect::<Vec<_>>()
        };
        self.papers.iter().flat_map(of).collect()
    }
}

const HOW_TO_READ: [&str; 3] = [
    "Each claim of a table or figure has a rule, and the rule alone gives the verdict: it holds where \
     all its figures are there and keep the rule, it breaks where one does not, and it is not measured \
     where a figure is missing.",
    "Ours are times of machines of today: a time that is reached says that nothing was lost since, a \
     ratio of two times of one machine says more.",
    "Figures of one claim are of one source: this run where it has as many of them as a record, else \
     the newest record that has most.",
];
