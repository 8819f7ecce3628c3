//! The report for people, and as CSV.

use std::fmt::Write;

use super::rows::{AccuracyReport, AccuracyRow, Percentiles};
use crate::study::machine::Machine;

/// A table for a terminal.
pub fn text(report: &AccuracyReport) -> String {
    let Machine { cpu, threads, gpu, rustc, optimised, commit, command, .. } = &report.machine;
    let mut text = String::new();
    let gpu = gpu.as_deref().unwrap_or("no GPU");
    let debug = if *optimised { "" } else { ", NOT OPTIMISED: times mean nothing" };
    let _ = writeln!(text, "{cpu}, {threads} threads, {gpu}; {rustc}; commit {commit}{debug}");
    let _ = writeln!(text, "{command}");
    let _ = write!(
        text,
        "\n{:<9} {:>8} {:<12} {:<10} {:<10} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>10} {:>10} {:>9} {:>7} {:>9} {:>7}",
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
        "MiB",
    );
    for row in &report.rows {
        let p50 = |times: &Percentiles| times.p50 as f64 / 1e6;
        let times = &row.times;
        let extra = row.extra_ratio.map_or("-".to_owned(), |ratio| format!("{:.3}", 100.0 * ratio));
        let missed = if row.checked_frames == 0 { "-".to_owned() } else { row.missed.to_string() };
        let _ = write!(
            text,
            "\n{:<9} {:>8} {:<12} {:<10} {:<10} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>10} {:>10} {:>9} {missed:>7} {extra:>9} {:>7}",
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
    text
}

/// Stages of a row by the names of their columns.
fn stages(row: &AccuracyRow) -> [(&'static str, Percentiles); 9] {
    let times = &row.times;
    [
        ("fill", times.fill_ns),
        ("ingest", times.ingest_ns),
        ("plan", times.plan_ns),
        ("execute", times.execute_ns),
        ("publish", times.publish_ns),
        ("engine_time", times.engine_ns),
        ("round_trip", times.round_trip_ns),
        ("decode", times.decode_ns),
        ("total", times.total_ns),
    ]
}

/// One line a row, one head line; empty fields where there is no number.
pub fn csv(report: &AccuracyReport) -> String {
    let mut text = String::from(
        "scene,n,mode,margin,backend,engine,served_by_engine,frames,requests,bytes_up,bytes_down,checked_frames,true_pairs,missed,extra,extra_ratio,memory_bytes",
    );
    for stage in [
        "fill",
        "ingest",
        "plan",
        "execute",
        "publish",
        "engine_time",
        "round_trip",
        "decode",
        "total",
    ] {
        let _ = write!(text, ",{stage}_p50_ns,{stage}_p99_ns");
    }
    text.push('\n');
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
        for (_, Percentiles { p50, p99 }) in stages(row) {
            let _ = write!(text, ",{p50},{p99}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::{report, row};
    use super::*;

    #[test]
    fn rows_have_as_many_fields_as_the_head() {
        let report = report(vec![row(), AccuracyRow { margin: None, extra_ratio: None, ..row() }]);
        let csv = csv(&report);
        let counts: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [35; 3]);
        let head = csv.lines().next().unwrap_or_default();
        for (name, _) in stages(&row()) {
            assert!(head.contains(&format!(",{name}_p50_ns,{name}_p99_ns")), "{name}");
        }
        let text = text(&report);
        assert!(text.contains("margin=0.1") && text.contains("40/200"), "{text}");
    }
}
