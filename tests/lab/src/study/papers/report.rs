//! The page's data: what its JSON has.

use std::fs;
use std::path::Path;

use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;

use super::model::Paper;
use super::records::Figures;
use super::{PapersError, avril2009, avril2012, avril2014, page, suaib2015};
use crate::study::machine::Machine;
use crate::study::verdict::Verdict;

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
    pub(super) fn of(machine: Machine, only_records: bool, figures: &Figures) -> Self {
        let papers = vec![
            avril2009::paper(figures),
            avril2012::paper(figures),
            avril2014::paper(figures),
            suaib2015::paper(figures),
        ];
        let mut sources: Vec<Source> = Vec::new();
        let named = |from: &str| {
            let rows = papers.iter().flat_map(Paper::claims).flat_map(|(_, claim)| &claim.rows);
            let mut names = rows.filter_map(|row| row.from.as_deref());
            names.any(|name| name.split(", ").any(|name| name == from))
        };
        for (from, machine) in figures.sources() {
            let source = Source { from, machine };
            if named(&source.from) && !sources.contains(&source) {
                sources.push(source);
            }
        }
        Self {
            machine,
            only_records,
            summary: papers.iter().map(summary).collect(),
            breaks: sentences(&papers, Verdict::Breaks),
            holds: sentences(&papers, Verdict::Holds),
            not_measured: sentences(&papers, Verdict::NotMeasured),
            papers,
            sources,
        }
    }

    /// The page as Markdown.
    pub fn markdown(&self) -> String {
        page::markdown(self)
    }

    /// Writes `papers.md`, `papers.html` and `papers.json` into a folder that is there.
    ///
    /// # Errors
    /// [`PapersError::File`], [`PapersError::Json`].
    pub fn write_files(&self, folder: &Path) -> Result<(), PapersError> {
        let json = serde_json::to_string_pretty(self)? + "\n";
        fs::write(folder.join("papers.md"), self.markdown())
            .and_then(|()| fs::write(folder.join("papers.html"), page::html(self)))
            .and_then(|()| fs::write(folder.join("papers.json"), json))
            .map_err(FileError::of(folder, Access::WriteInto))?;
        Ok(())
    }
}

fn summary(paper: &Paper) -> Summary {
    let nothing = paper.items.iter().filter(|item| item.nothing_to_measure.is_some());
    Summary {
        paper: paper.name,
        tables_and_figures: paper.items.len(),
        nothing_to_measure: nothing.count(),
        holds: paper.count(Verdict::Holds),
        breaks: paper.count(Verdict::Breaks),
        not_measured: paper.count(Verdict::NotMeasured),
    }
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

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// A report of no record: what the code alone decides.
    pub fn empty() -> PapersReport {
        PapersReport::of(Machine::here(None), true, &Figures::default())
    }

    #[test]
    fn every_table_and_figure_is_listed_once_and_has_claims_or_a_reason() {
        let report = empty();
        // Figures 1 to 15; tables 1 to 7 and figures 1 to 6; figures 1 to 15; table 1, figures 1 to 8.
        let counts: Vec<_> = report.summary.iter().map(|row| row.tables_and_figures).collect();
        assert_eq!(counts, [15, 13, 15, 9]);
        for paper in &report.papers {
            let places: BTreeSet<_> = paper.items.iter().map(|item| item.place).collect();
            assert_eq!(places.len(), paper.items.len(), "{}", paper.name);
            for item in &paper.items {
                let says = item.claims.is_empty() == item.nothing_to_measure.is_some();
                assert!(says, "{} {}", paper.name, item.place);
            }
        }
    }

    #[test]
    fn without_records_nothing_is_invented() {
        let report = empty();
        assert!(report.sources.is_empty());
        for (item, claim) in report.papers.iter().flat_map(Paper::claims) {
            let is_code = item.place == "Table 1" && claim.says.contains("pair");
            assert_eq!(claim.verdict == Verdict::NotMeasured, !is_code, "{claim:?}");
            assert!(is_code || !claim.why.is_empty(), "{claim:?}");
        }
        let claims: usize = report.papers.iter().map(|paper| paper.claims().count()).sum();
        let told = report.breaks.len() + report.holds.len() + report.not_measured.len();
        assert_eq!(told, claims);
    }
}
