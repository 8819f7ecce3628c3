//! Comparisons as text, Markdown and JSON. The ratio comes first.

use std::fmt::Write as _;

use serde_json::json;

use super::line::{Comparison, PeerRow, Spread, Who};

pub const HEAD: &str = "\
Ratio: our time over the peer's, medians. Time: from the user's boxes to all pairs iterated over (ours: \
write, submit, wait, decode; theirs: update from the boxes, iterate over every pair), µs, with the tenth and \
the nine-tenth of the frames in brackets. Write: the part of ours that writes the boxes into the \
session's memory, µs. Late: ratio over the last tenth of the frames. A peer's time is that of its best number \
of threads (behind t) up to ours. * marks the best peer that returned every pair.";

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

fn spread(times: &Spread) -> String {
    format!("{:.1} [{:.1} {:.1}]", us(times.median_ns), us(times.p10_ns), us(times.p90_ns))
}

fn cells(row: &PeerRow<'_>) -> [String; 13] {
    let [ratio, late] = row.ratios();
    [
        format!("{ratio:.2}{}", if row.is_best_peer { "*" } else { "" }),
        format!("{late:.2}"),
        row.of.scene.to_string(),
        row.of.n.to_string(),
        row.ours.threads.to_string(),
        row.backend.to_owned(),
        row.engine.to_owned(),
        spread(&row.ours.frame),
        format!("{:.1}", us(row.ours.write.median_ns)),
        format!("{} t{}", row.peer, row.theirs.threads),
        spread(&row.theirs.frame),
        row.of.pairs.to_string(),
        if row.are_pairs_equal() { "yes" } else { "NO" }.to_owned(),
    ]
}

/// Heads of the columns, and widths in the text table: wider cells push the rest of their line.
const COLUMNS: [(&str, usize); 13] = [
    ("ratio", 6),
    ("late", 6),
    ("scene", 8),
    ("n", 9),
    ("threads", 7),
    ("backend", 10),
    ("engine", 14),
    ("ours µs", 28),
    ("write µs", 9),
    ("peer", 17),
    ("peer µs", 28),
    ("pairs", 9),
    ("equal", 5),
];

fn heads() -> [String; 13] {
    COLUMNS.map(|(head, _)| head.to_owned())
}

fn text_line(cells: &[String; 13]) -> String {
    let cells = cells.iter().zip(COLUMNS).map(|(cell, (_, width))| format!("{cell:>width$} "));
    cells.collect::<String>().trim_end().to_owned() + "\n"
}

pub fn text_head() -> String {
    text_line(&heads())
}

pub fn text(comparison: &Comparison) -> String {
    let mut text: String = comparison.rows().iter().map(|row| text_line(&cells(row))).collect();
    for line in &comparison.lines {
        let who = match &line.who {
            Who::Ours { backend, engine } => format!("{backend}, {engine}"),
            Who::Peer(name) => name.to_string(),
        };
        let given_up = line.is_given_up.then_some("left out of most frames, it takes minutes");
        for what in given_up.into_iter().chain(line.fault.as_deref()) {
            let _ = writeln!(text, "    {who} on {} threads: {what}", line.threads);
        }
    }
    text
}

pub fn markdown(comparisons: &[Comparison]) -> String {
    let mut text = format!("{HEAD}\n\n| {} |\n|{}\n", heads().join(" | "), "---|".repeat(13));
    for row in comparisons.iter().flat_map(Comparison::rows) {
        let _ = writeln!(text, "| {} |", cells(&row).join(" | "));
    }
    text
}

/// One comparison as JSON lines, one a row. Fields are a contract: none is added or taken away.
pub fn json_lines(comparison: &Comparison) -> String {
    let mut text = String::new();
    for row in comparison.rows() {
        let object = json!({
            "scene": comparison.scene.as_str(),
            "n": comparison.n,
            "threads": row.ours.threads,
            "backend": row.backend,
            "engine": row.engine,
            "ours_ns": row.ours.frame.median_ns,
            "peer": row.peer.to_string(),
            "peer_ns": row.theirs.frame.median_ns,
            "ratio": row.ratios()[0],
            "pairs": comparison.pairs,
            "pairs_equal": row.are_pairs_equal(),
        });
        let _ = writeln!(text, "{object}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::line::tests::comparison;
    use super::*;

    #[test]
    fn json_rows_have_the_fields_of_the_contract_and_no_others() {
        let lines = json_lines(&comparison());
        assert_eq!(lines.lines().count(), 6, "one row for each of our lines and each peer");
        for line in lines.lines() {
            let row: serde_json::Value = serde_json::from_str(line).expect("JSON");
            let fields: Vec<&str> =
                row.as_object().expect("an object").keys().map(String::as_str).collect();
            assert_eq!(
                fields.join(" "),
                "backend engine n ours_ns pairs pairs_equal peer peer_ns ratio scene threads"
            );
        }
        assert!(lines.starts_with('{') && lines.contains(r#""ratio":0.6"#), "{lines}");
    }

    #[test]
    fn tables_have_as_many_cells_as_columns_and_the_ratio_first() {
        let comparisons = [comparison()];
        let markdown = markdown(&comparisons);
        let table = markdown.lines().filter(|line| line.starts_with('|'));
        assert!(table.clone().count() == 8 && table.clone().all(|l| l.matches('|').count() == 14));
        assert!(markdown.contains("| 0.60* |"), "{markdown}");
        let text = text(&comparisons[0]);
        assert!(text.contains("0.60*") && text.contains("a pair is missing"), "{text}");
    }
}
