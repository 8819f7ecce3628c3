//! The page as HTML.

use maud::{DOCTYPE, Markup, PreEscaped, html as markup};

use super::{HOW_TO_READ, cells, made_of};
use crate::study::papers::model::{Claim, Paper};
use crate::study::papers::report::PapersReport;
use crate::study::verdict::Verdict;

const STYLE: &str = "\
:root{color-scheme:light dark}\
body{font:15px/1.5 system-ui,sans-serif;max-width:1100px;margin:2rem auto;padding:0 1rem}\
h2{margin-top:2.5rem}h3{margin:1.8rem 0 .3rem}p{max-width:60em;margin:.4rem 0}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.4rem 0 1rem}\
td,th{padding:.15rem .7rem;text-align:right;border-bottom:1px solid #8884}\
td.name,th.name{text-align:left}.scroll{overflow-x:auto}.note{opacity:.75}li{margin:.2rem 0}\
.holds{color:#009e73;font-weight:600}.breaks{color:#d55e00;font-weight:600}\
.missing{color:#8a8a8a;font-weight:600}";

/// The page: one file that loads nothing.
pub fn html(report: &PapersReport) -> String {
    markup! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Pairmask: the papers, theirs beside ours" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "The papers, theirs beside ours" }
                p { (made_of(report)) }
                p { code { (report.machine.command) } }
                (summary(report))
                @for sentence in HOW_TO_READ { p { (sentence) } }
                (list("What breaks", &report.breaks))
                (list("What holds", &report.holds))
                (list("What is not measured", &report.not_measured))
                @for of_it in &report.papers { (paper(of_it)) }
                h2 { "Sources" }
                div.scroll { table {
                    tr { th.name { "source" } th.name { "machine" } }
                    @for source in &report.sources {
                        tr { td.name { (source.from) } td.name { (source.machine) } }
                    }
                } }
            }
        }
    }
    .into_string()
}

fn summary(report: &PapersReport) -> Markup {
    markup! {
        div.scroll { table {
            tr {
                th.name { "paper" } th { "tables and figures" } th { "nothing to measure" }
                th { "claims: hold" } th { "break" } th { "not measured" }
            }
            @for row in &report.summary {
                tr {
                    td.name { (row.paper) } td { (row.tables_and_figures) }
                    td { (row.nothing_to_measure) } td.holds { (row.holds) }
                    td.breaks { (row.breaks) } td { (row.not_measured) }
                }
            }
        } }
    }
}

fn list(title: &str, sentences: &[String]) -> Markup {
    markup! {
        h2 { (title) }
        ul { @for sentence in sentences { li { (sentence) } } }
    }
}

fn paper(paper: &Paper) -> Markup {
    markup! {
        h2 { (paper.name) }
        p { (paper.title) ". Measured on: " (paper.machine) "." }
        @for item in &paper.items {
            h3 { (item.place) ": " (item.shows) }
            @if let Some(why) = item.nothing_to_measure { p.note { "Nothing to measure: " (why) "." } }
            @for of_it in &item.claims { (claim(of_it)) }
        }
    }
}

const fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::Breaks => "breaks",
        Verdict::NotMeasured => "missing",
    }
}

fn claim(claim: &Claim) -> Markup {
    markup! {
        p {
            span class=(class(claim.verdict)) { (claim.verdict) } ": " (claim.says) ". "
            span.note {
                "Rule: " (claim.rule) ". "
                @if !claim.why.is_empty() { "Why: " (claim.why) ". " }
                (claim.note)
            }
        }
        @if !claim.rows.is_empty() {
            div.scroll { table {
                tr { th.name {} th { "paper" } th { "ours" } th { "ratio" } th.name { "from" } }
                @for row in &claim.rows {
                    @let [what, theirs, ours, ratio, from] = cells(row);
                    tr {
                        td.name { (what) } td { (theirs) } td { (ours) } td { (ratio) }
                        td.name { (from) }
                    }
                }
            } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::papers::report::tests::empty;

    #[test]
    fn the_page_loads_nothing_and_shows_every_table_and_figure() {
        let report = empty();
        let page = html(&report);
        for loading in ["http://", "https://", "src=", "<link", "<script", "@import", "url("] {
            assert!(!page.contains(loading), "{loading}");
        }
        let titles = page.matches("<h3>").count();
        assert_eq!(titles, report.summary.iter().map(|row| row.tables_and_figures).sum::<usize>());
    }
}
