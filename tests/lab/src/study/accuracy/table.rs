//! The report as text and as CSV.

use std::fmt::Write;

use super::rows::{AccuracyReport, AccuracyRow, AgainstBoxes, Percentiles, StageTimes};
use super::variants::VariantRow;
use crate::study::machine::Machine;

/// A table for a terminal.
pub fn text(report: &AccuracyReport) -> String {
    let Machine { cpu, threads, gpu, rustc, optimised, commit, command, .. } = &report.machine;
    // Writing to a String cannot fail, here and below.
    let mut text = String::new();
    let gpu = gpu.as_deref().unwrap_or("no GPU");
    let debug = if *optimised { "" } else { ", NOT OPTIMISED: times mean nothing" };
    let _ = writeln!(text, "{cpu}, {threads} threads, {gpu}; {rustc}; commit {commit}{debug}");
    let _ = writeln!(text, "{command}");
    let _ = write!(
        text,
        "\n{:<9} {:>8} {:<21} {:<10} {:<10} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>10} {:>10} {:>9} {:>7} {:>9} {:>16} {:>7}",
        "scene",
        "n",
        "mode",
        "backend",
        "engine",
        "p50 ms",
        "p99 ms",
        "fill",
        "engine",
        "trip",
        "decode",
        "bytes up",
        "down",
        "requests",
        "missed",
        "extra %",
        "against boxes %",
        "MiB",
    );
    for row in &report.rows {
        let p50 = |times: &Percentiles| times.p50 as f64 / 1e6;
        let times = &row.times;
        let percent =
            |ratio: Option<f64>| ratio.map_or("-".to_owned(), |x| format!("{:.3}", 100.0 * x));
        let extra = percent(row.extra_ratio);
        let boxes = row.against_boxes.map_or_else(String::new, |boxes| against(&boxes, percent));
        let missed = if row.checked_frames == 0 { "-".to_owned() } else { row.missed.to_string() };
        let _ = write!(
            text,
            "\n{:<9} {:>8} {:<21} {:<10} {:<10} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>10} {:>10} {:>9} {missed:>7} {extra:>9} {boxes:>16} {:>7}",
            row.scene,
            row.n,
            row.mode_text(),
            row.backend,
            row.served_by_engine,
            p50(&times.total_ns),
            times.total_ns.p99 as f64 / 1e6,
            p50(&times.fill_ns),
            p50(&times.engine_ns),
            p50(&times.round_trip_ns),
            p50(&times.decode_ns),
            row.bytes_up,
            row.bytes_down,
            format!("{}/{}", row.requests, row.frames),
            row.memory_bytes >> 20,
        );
    }
    let _ = write!(text, "\n\n{}", report.pareto);
    if !report.variants.is_empty() {
        let _ = write!(text, "\n\n{}", variants_text(&report.variants));
    }
    text
}

/// Extra and missed pairs against the boxes', in percent.
fn against(boxes: &AgainstBoxes, percent: impl Fn(Option<f64>) -> String) -> String {
    let missed = AccuracyRow::ratio(boxes.missed, boxes.true_pairs).filter(|_| boxes.missed > 0);
    let minus = missed.map_or_else(String::new, |_| format!(" -{}", percent(missed)));
    format!("+{}{minus}", percent(boxes.extra_ratio))
}

/// A table of the ways to turn a pair's number into the pair.
fn variants_text(rows: &[VariantRow]) -> String {
    let mut text = String::from("Mapping functions (Avril et al. 2012; none serves a client)\n");
    let _ = write!(
        text,
        "{:<30} {:>8} {:<9} {:>10} {:>12} {:>11} {:>9}",
        "variant", "n", "processor", "ps a pair", "wrong %", "missed %", "rows off"
    );
    for row in rows {
        let ps = row.ps_per_pair.map_or("-".to_owned(), |ps| format!("{ps:.0}"));
        // A sample gives only an upper bound of the missed pairs.
        let at_most = if row.missed_share[0] < row.missed_share[1] { "<" } else { "" };
        let _ = write!(
            text,
            "\n{:<30} {:>8} {:<9} {ps:>10} {:>12.6} {:>11} {:>9}",
            row.variant,
            row.n,
            row.processor,
            100.0 * row.wrong_share,
            format!("{at_most}{:.6}", 100.0 * row.missed_share[1]),
            row.largest_row_error,
        );
    }
    text
}

/// One line a row, one head line; empty fields where there is no number.
pub fn csv(report: &AccuracyReport) -> String {
    let mut text = String::from(
        "scene,n,mode,margin,backend,engine,served_by_engine,frames,requests,bytes_up,bytes_down,checked_frames,true_pairs,missed,extra,extra_ratio,memory_bytes",
    );
    for (stage, _) in StageTimes::default().by_name() {
        let _ = write!(text, ",{stage}_p50_ns,{stage}_p99_ns");
    }
    text.push_str(",offset,spheres,boxes_missed,boxes_extra,boxes_extra_ratio\n");
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| x.to_string());
    for row in &report.rows {
        let _ = write!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            row.scene,
            row.n,
            row.mode,
            number(row.margin),
            row.backend,
            row.engine,
            row.served_by_engine,
            row.frames,
            row.requests,
            row.bytes_up,
            row.bytes_down,
            row.checked_frames,
            row.true_pairs,
            row.missed,
            row.extra,
            number(row.extra_ratio),
            row.memory_bytes,
        );
        for (_, Percentiles { p50, p99 }) in row.times.by_name() {
            let _ = write!(text, ",{p50},{p99}");
        }
        let boxes = row.against_boxes;
        let count =
            |of: fn(AgainstBoxes) -> u64| boxes.map_or_else(String::new, |b| of(b).to_string());
        let _ = writeln!(
            text,
            ",{},{},{},{},{}",
            number(row.offset),
            row.spheres.as_deref().unwrap_or_default(),
            count(|b| b.missed),
            count(|b| b.extra),
            number(boxes.and_then(|b| b.extra_ratio)),
        );
    }
    text
}

/// The ways to turn a pair's number into the pair, as CSV.
pub fn variants_csv(rows: &[VariantRow]) -> String {
    let mut text = String::from(
        "variant,n,processor,ps_per_pair,is_complete,ids,wrong,wrong_share,missed_share_least,missed_share_most,largest_row_error\n",
    );
    for row in rows {
        let VariantRow { variant, n, processor, is_complete, ids, wrong, wrong_share, .. } = row;
        let ps = row.ps_per_pair.map_or_else(String::new, |ps| ps.to_string());
        let [least, most] = row.missed_share;
        let _ = writeln!(
            text,
            "{variant},{n},{processor},{ps},{is_complete},{ids},{wrong},{wrong_share},{least},{most},{}",
            row.largest_row_error,
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::{report, row};
    use super::super::variants;
    use super::*;

    #[test]
    fn rows_have_as_many_fields_as_the_head() {
        let boxes = AgainstBoxes { true_pairs: 100, missed: 2, extra: 7, extra_ratio: Some(0.07) };
        let spheres = AccuracyRow {
            mode: "spheres".to_owned(),
            margin: None,
            spheres: Some("inscribed".to_owned()),
            extra_ratio: None,
            against_boxes: Some(boxes),
            ..row()
        };
        let mut report = report(vec![row(), spheres]);
        report.variants = vec![variants::tests::row("lazy", 1.5, 0.0)];
        let csv = csv(&report);
        let counts: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [40; 3]);
        assert!(csv.ends_with(",,inscribed,2,7,0.07\n"), "{csv}");
        let head = csv.lines().next().unwrap_or_default();
        for (name, _) in row().times.by_name() {
            assert!(head.contains(&format!(",{name}_p50_ns,{name}_p99_ns")), "{name}");
        }
        let text = text(&report);
        assert!(text.contains("margin=0.1") && text.contains("40/200"), "{text}");
        assert!(text.contains("spheres=inscribed") && text.contains("+7.000 -2.000"), "{text}");
        assert!(text.contains("Nowhere on it: spheres=inscribed"), "{text}");
        assert!(text.contains("lazy"), "{text}");
        let variants = variants_csv(&report.variants);
        let counts: Vec<usize> = variants.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [11; 2]);
    }
}
