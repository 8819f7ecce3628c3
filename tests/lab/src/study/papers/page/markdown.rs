//! The page as Markdown.

use std::fmt::{self, Write as _};

use super::{HOW_TO_READ, cells, made_of};
use crate::study::papers::model::{Claim, Item, Paper};
use crate::study::papers::report::PapersReport;

/// The page.
pub fn markdown(report: &PapersReport) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write(report, &mut text);
    text
}

fn write(report: &PapersReport, out: &mut String) -> fmt::Result {
    writeln!(out, "# The papers, theirs beside ours\n")?;
    writeln!(out, "{}\n", made_of(report))?;
    writeln!(out, "`{}`\n", report.machine.command)?;
    writeln!(
        out,
        "| paper | tables and figures | nothing to measure | claims: hold | break | not measured |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    for row in &report.summary {
        writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} |",
            row.paper,
            row.tables_and_figures,
            row.nothing_to_measure,
            row.holds,
            row.breaks,
            row.not_measured
        )?;
    }
    writeln!(out, "\n{}", HOW_TO_READ.join(" "))?;
    for (title, sentences) in [
        ("What breaks", &report.breaks),
        ("What holds", &report.holds),
        ("What is not measured", &report.not_measured),
    ] {
        writeln!(out, "\n## {title}\n")?;
        for sentence in sentences {
            writeln!(out, "- {sentence}")?;
        }
    }
    for paper in &report.papers {
        write_paper(paper, out)?;
    }
    writeln!(out, "\n## Sources\n\n| source | machine |\n|---|---|")?;
    for source in &report.sources {
        writeln!(out, "| {} | {} |", source.from, in_cell(&source.machine))?;
    }
    Ok(())
}

fn write_paper(paper: &Paper, out: &mut String) -> fmt::Result {
    writeln!(out, "\n## {}\n\n{}. Measured on: {}.", paper.name, paper.title, paper.machine)?;
    for Item { place, shows, nothing_to_measure, claims } in &paper.items {
        writeln!(out, "\n### {place}: {shows}")?;
        if let Some(why) = nothing_to_measure {
            writeln!(out, "\nNothing to measure: {why}.")?;
        }
        for claim in claims {
            write_claim(claim, out)?;
        }
    }
    Ok(())
}

fn write_claim(claim: &Claim, out: &mut String) -> fmt::Result {
    let Claim { says, rule, verdict, why, note, rows } = claim;
    writeln!(out, "\n**{verdict}**: {says}. Rule: {rule}.{}", sentence(why))?;
    if !note.is_empty() {
        writeln!(out, "{note}")?;
    }
    if rows.is_empty() {
        return Ok(());
    }
    writeln!(out, "\n| | paper | ours | ratio | from |\n|---|---|---|---|---|")?;
    for row in rows {
        let [what, paper, ours, ratio, from] = cells(row);
        writeln!(out, "| {what} | {paper} | {ours} | {ratio} | {from} |")?;
    }
    Ok(())
}

fn sentence(why: &str) -> String {
    if why.is_empty() { String::new() } else { format!(" Why: {why}.") }
}

/// A bar would end the cell.
fn in_cell(text: &str) -> String {
    text.replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::papers::report::tests::empty;

    #[test]
    fn the_page_opens_with_the_summary_and_what_breaks() {
        let text = markdown(&empty());
        let place = |part: &str| text.find(part).unwrap_or_else(|| panic!("no {part}:\n{text}"));
        let parts =
            ["| paper |", "## What breaks", "## What holds", "## Avril 2009", "## Suaib 2015"];
        assert!(parts.map(place).is_sorted(), "{text}");
        assert!(text.contains("Avril 2012, Table 1: the last pair has the number"), "{text}");
        assert!(text.contains("ours 499499, the paper's 499500"), "{text}");
    }
}
