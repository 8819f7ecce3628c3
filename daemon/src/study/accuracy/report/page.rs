//! The page.

use std::collections::BTreeSet;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::figures::{
    self, engine_name, front_verdicts, percentiles, scaling, speed_against_error, stages,
};
use crate::study::accuracy::rows::{AccuracyReport, AccuracyRow};
use crate::study::machine::Machine;
use crate::study::plot::{STYLE, Unit};

const PAGE_STYLE: &str = "\
:root{color-scheme:light dark}\
body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2rem auto;padding:0 1rem}\
h1{margin-bottom:.2rem}h2{margin-top:2.5rem}code{font-size:.92em}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(540px,1fr));gap:1.5rem}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
td,th{white-space:nowrap;padding:.15rem .7rem;text-align:right;border-bottom:1px solid #8884}\
td.name,th.name{text-align:left}.scroll{overflow-x:auto}\
.good{color:#009e73;font-weight:600}.bad{color:#d55e00;font-weight:600}";

/// The whole report as one HTML page that loads nothing.
pub fn html(report: &AccuracyReport) -> String {
    let settings = figures::settings(&report.rows);
    let scenes: Vec<&str> = {
        let mut seen = BTreeSet::new();
        report.rows.iter().map(|r| r.scene.as_str()).filter(|s| seen.insert(*s)).collect()
    };
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Pairmask: run time against error" }
                style { (PreEscaped(PAGE_STYLE)) (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Run time against error" }
                p { (missed(&report.rows)) " Seed " (report.seed) "." }
                (machine(&report.machine))

                h2 { "Which mode pays" }
                p {
                    "A mode is on the Pareto front of a scene and size if no other one that misses "
                    "nothing is at least as fast with no more extra pairs, and better in one of both."
                }
                (verdicts(&report.rows))

                h2 { "Speed against error" }
                p {
                    "Whole frame (boxes written, pairs found, every pair looked at), median, against "
                    "extra pairs. Dominated points are grey; the dashed line is the front. Rest the "
                    "pointer on a point to read it."
                }
                div.plots { @for setting in &settings { (speed_against_error(setting).draw()) } }

                h2 { "Scaling, with the papers beside" }
                div.plots { @for scene in &scenes { (scaling(scene, &report.rows).draw()) } }

                h2 { "Percentiles" }
                div.plots { @for scene in &scenes { (percentiles(scene, &report.rows).draw()) } }

                h2 { "Where the time goes" }
                p {
                    "Medians of the stages; medians do not add up exactly. \"The way\" is the round "
                    "trip without the engine: the transport and both sides' waiting."
                }
                div.plots { @for setting in &settings { (stages(setting).draw()) } }

                h2 { "All rows" }
                (table(&report.rows))
            }
        }
    }
    .into_string()
}

fn missed(rows: &[AccuracyRow]) -> Markup {
    let missed: u64 = rows.iter().map(|row| row.missed).sum();
    let checked: u64 = rows.iter().map(|row| row.checked_frames).sum();
    let pairs: u64 = rows.iter().map(|row| row.true_pairs).sum();
    html! {
        @if missed == 0 {
            span.good { "No pair was missed" } " in " (checked) " checked frames with " (pairs)
            " overlapping pairs."
        } @else {
            span.bad { (missed) " pairs were missed" } " in " (checked) " checked frames."
        }
    }
}

fn machine(machine: &Machine) -> Markup {
    html! {
        table {
            tr { th.name { "CPU" } td.name { (machine.cpu) ", " (machine.threads) " threads" } }
            @if let Some(gpu) = &machine.gpu {
                tr {
                    th.name { "GPU" }
                    td.name {
                        (gpu) ", " (machine.driver.as_deref().unwrap_or("driver unknown"))
                        @if machine.gpu_is_software { " (software: its times are the CPU's)" }
                    }
                }
            }
            tr {
                th.name { "Build" }
                td.name {
                    (machine.rustc) ", commit " (machine.commit)
                    @if !machine.optimised { ", " span.bad { "not optimised: the times compare nothing" } }
                }
            }
            tr { th.name { "Command" } td.name { code { (machine.command) } } }
        }
    }
}

fn verdicts(rows: &[AccuracyRow]) -> Markup {
    html! {
        table {
            tr { th.name { "mode" } th { "scenes and sizes" } th { "on the front" } th.name {} }
            @for verdict in front_verdicts(rows) {
                tr {
                    td.name { (verdict.mode) }
                    td { (verdict.settings) }
                    td { (verdict.on_front) }
                    td.name { @if verdict.on_front == 0 { "not on the front anywhere" } }
                }
            }
        }
    }
}

fn table(rows: &[AccuracyRow]) -> Markup {
    let ns = |ns: u64| Unit::Nanoseconds.text(ns as f64);
    let bytes = |bytes: u64| Unit::Bytes.text(bytes as f64);
    html! {
        div.scroll { table {
            tr {
                th.name { "scene" } th { "boxes" } th.name { "mode" } th.name { "engine" }
                th { "frame p50" } th { "p99" } th { "round trip p50" } th { "p99" }
                th { "bytes up" } th { "bytes down" } th { "missed" } th { "extra" }
                th { "extra a pair" } th { "requests" } th { "memory" }
            }
            @for row in rows {
                tr {
                    td.name { (row.scene) } td { (row.n) } td.name { (row.mode_text()) }
                    td.name { (engine_name(row)) }
                    td { (ns(row.times.total_ns.p50)) } td { (ns(row.times.total_ns.p99)) }
                    td { (ns(row.times.round_trip_ns.p50)) } td { (ns(row.times.round_trip_ns.p99)) }
                    td { (bytes(row.bytes_up)) } td { (bytes(row.bytes_down)) }
                    td { @if row.missed == 0 { "0" } @else { span.bad { (row.missed) } } }
                    td { (row.extra) }
                    td { (row.extra_ratio.map_or("-".to_owned(), |x| Unit::Ratio.text(x))) }
                    td { (row.requests) "/" (row.frames) }
                    td { (bytes(row.memory_bytes)) }
                }
            }
        } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::accuracy::rows::{self, Percentiles, StageTimes};

    fn row(mode: &str, p50: u64, extra: u64, missed: u64) -> AccuracyRow {
        let total_ns = Percentiles { p50, p99: 2 * p50 };
        AccuracyRow {
            mode: mode.to_owned(),
            margin: None,
            times: StageTimes { total_ns, ..StageTimes::default() },
            true_pairs: 1000,
            missed,
            extra,
            extra_ratio: AccuracyRow::ratio(extra, 1000),
            ..rows::tests::row()
        }
    }

    fn page(rows: Vec<AccuracyRow>) -> String {
        let mut machine = Machine::here(None);
        "bench <accuracy>".clone_into(&mut machine.command);
        html(&AccuracyReport { machine, seed: 7, rows })
    }

    #[test]
    fn a_page_loads_nothing_and_says_what_it_ran_on() {
        let page = page(vec![row("exact", 2000, 0, 0), row("q16", 1000, 3, 0)]);
        let without_namespace = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for outside in ["http:", "https:", "src=", "href=", "url(", "@import", "<script"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        assert!(page.contains("No pair was missed"));
        assert!(page.contains("bench &lt;accuracy&gt;"), "the command is escaped");
        assert!(page.contains(env!("PAIRMASK_COMMIT")));
    }

    #[test]
    fn a_missed_pair_is_told_first_and_keeps_its_mode_off_the_front() {
        let rows = vec![row("exact", 2000, 0, 0), row("q16", 1000, 3, 1), row("q8", 3000, 9, 0)];
        let verdicts = front_verdicts(&rows);
        let on_front: Vec<usize> = verdicts.iter().map(|v| v.on_front).collect();
        assert_eq!(on_front, [1, 0, 0]);
        let page = page(rows);
        assert!(page.contains("1 pairs were missed"));
        assert_eq!(page.matches("not on the front anywhere").count(), 2);
    }

    #[test]
    fn a_large_study_stays_below_two_megabytes() {
        let rows = (0..600).map(|i| {
            let mut row = row(["exact", "q16", "q8", "f16"][i % 4], 1000 + i as u64, 3, 0);
            row.scene = format!("scene {}", i / 60);
            row.n = [1_000, 10_000, 100_000, 1_000_000][i / 4 % 4];
            row.engine = format!("engine {}", i % 60 / 16);
            row
        });
        let bytes = page(rows.collect()).len();
        assert!(bytes < 2_000_000, "{bytes}");
    }
}
