//! The page.

use std::collections::BTreeSet;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use pairmaskd::plot::{STYLE, Unit};

use super::choice;
use super::figures::{
    engine_name, mapping, mapping_settings, paper_lines, percentiles, scaling, speed_against_error,
    stages,
};
use crate::study::accuracy::pareto::{ModeVerdict, Pareto, modes};
use crate::study::accuracy::rows::{AccuracyReport, AccuracyRow, StageTimes};
use crate::study::accuracy::setting::{Setting, settings};
use crate::study::accuracy::variants::VariantRow;
use crate::study::machine::Machine;

const PAGE_STYLE: &str = "\
:root{color-scheme:light dark}\
body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2rem auto;padding:0 1rem}\
h1{margin-bottom:.2rem}h2{margin-top:2.5rem}h3{margin-top:1.5rem}code{font-size:.92em}p{max-width:60em}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(540px,100%),1fr));gap:1.5rem}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
td,th{white-space:nowrap;padding:.15rem .7rem;text-align:right;border-bottom:1px solid #8884}\
td.name,th.name{text-align:left}.facts td,td.long{white-space:normal}.rows{font-size:13px}\
.rows td,.rows th{padding:.1rem .45rem}.rows tr:hover{background:#8882}\
.scroll{overflow-x:auto}.choice td,.choice th{white-space:normal;vertical-align:top}.choice .name:nth-child(2){min-width:11em;max-width:36em}.facts td{overflow-wrap:anywhere}summary{cursor:pointer;margin:.5rem 0}\
@media(max-width:600px){body{margin:1rem auto;padding:0 .6rem}h1{font-size:1.5rem}td,th{padding:.15rem .3rem}.choice{font-size:11.5px}.choice .name:nth-child(2){min-width:8em}}\
.good{color:#009e73;font-weight:600}.bad{color:#d55e00;font-weight:600}";

/// The whole report as one HTML page that loads nothing.
pub fn html(report: &AccuracyReport) -> String {
    let settings = settings(&report.rows);
    let modes = modes(&report.rows);
    let scenes = in_order(report.rows.iter().map(|row| row.scene.as_str()));
    let engines = in_order(report.rows.iter().map(|row| row.engine.as_str()));
    let papers = paper_lines();
    // Whether a plot of the rows near the origin would have points.
    let has = |is_its: &dyn Fn(&AccuracyRow) -> bool| {
        report.rows.iter().any(|row| row.offset.is_none() && is_its(row))
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
                p { (missed(&report.rows)) }
                @if !report.machine.optimised {
                    p { span.bad { "The build is not optimised" } ": the times compare nothing." }
                }
                h2 { "What to choose" }
                p {
                    "Modes against exact frames of the same scene, size and engine: a time below 1 is faster. "
                    "Extra pairs are reported though the boxes do not overlap, in percent of the pairs that do. "
                    "No mode may miss a pair."
                }
                (choice::table(&report.rows))

                h2 { "Which mode pays where" }
                p {
                    "A mode is on the Pareto front of a scene, size and distance from the origin if no other one that misses "
                    "nothing is at least as fast (median of a whole frame), with no more extra pairs "
                    "and no more bytes up, and better in one of the three. Medians count as they were "
                    "measured: a nanosecond decides where all else is equal."
                }
                (verdicts(&report.pareto))

                @if has(&|_| true) {
                    h2 { "Speed against error" }
                    p {
                        "Whole frame (boxes written, pairs found, every pair looked at), median, against "
                        "extra pairs. The dashed line is the front of these two; a ring is worth its time "
                        "only for the bytes that it saves; what is beaten in all three is grey, and what "
                        "missed a pair is not drawn. Rest the pointer on a point to read it."
                    }
                    div.plots {
                        @for setting in settings.iter().filter(|s| s.offset.is_none()) {
                            (speed_against_error(setting, &modes).draw())
                        }
                    }
                    (sphere_note(&report.rows))
                }

                (worlds(&settings))

                @if has(&|_| true) {
                    h2 { "Scaling, with the papers beside" }
                    p { "The papers' lines are theirs: their scenes, their machines, what they counted as a frame." }
                    div.plots {
                        @for scene in scenes.iter().filter(|s| has(&|r| r.scene == **s && r.mode == "exact")) {
                            (scaling(scene, &report.rows).draw_beside(&papers))
                        }
                    }

                    h2 { "Percentiles" }
                    p { "Lines through the medians, bars up to the 99th percentiles." }
                    div.plots {
                        @for scene in &scenes {
                            @for engine in engines.iter().filter(|e| has(&|r| r.scene == *scene && r.engine == **e)) {
                                (percentiles(scene, engine, &report.rows, &modes).draw())
                            }
                        }
                    }

                    h2 { "Where the time goes" }
                    p {
                        "Medians of the stages; medians do not add up exactly. \"The way\" is the round "
                        "trip without the engine: the transport and both sides' waiting."
                    }
                    div.plots {
                        @for setting in settings.iter().filter(|s| s.offset.is_none()) {
                            (stages(setting, &settings).draw())
                        }
                    }
                }

                @if !report.variants.is_empty() { (mapping_section(&report.variants)) }

                h2 { "Measured on" }
                (machine(&report.machine, report.seed))

                h2 { "All rows" }
                (table(&report.rows))
                h3 { "Stages, median / 99th percentile" }
                (stage_table(&report.rows))
            }
        }
    }
    .into_string()
}

/// Each name once, in the order of first occurrence.
fn in_order<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut seen = BTreeSet::new();
    names.filter(|name| seen.insert(*name)).collect()
}

fn missed(rows: &[AccuracyRow]) -> Markup {
    let missed: u64 = rows.iter().map(|row| row.missed).sum();
    let checked: u64 = rows.iter().map(|row| row.checked_frames).sum();
    let pairs: u64 = rows.iter().map(|row| row.true_pairs).sum();
    html! {
        @if checked == 0 {
            span.bad { "No frame was checked" } ": what is missed and extra is not known."
        } @else if missed == 0 {
            span.good { "No pair was missed" } " in " (checked) " checked frames with " (pairs)
            " overlapping pairs."
        } @else {
            span.bad { (missed) " pairs were missed" } " in " (checked) " checked frames."
        }
    }
}

fn machine(machine: &Machine, seed: u64) -> Markup {
    html! {
        table.facts {
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
            tr { th.name { "Seed" } td.name { (seed) } }
            tr { th.name { "Command" } td.name { code { (machine.command) } } }
        }
    }
}

fn verdicts(pareto: &Pareto) -> Markup {
    html! {
        div.scroll { table {
            tr {
                th.name { "mode" } th { "scenes and sizes" } th { "on the front" } th.name { "where" }
            }
            @for ModeVerdict { mode, settings, disqualified, on_front, at } in &pareto.modes {
                tr {
                    td.name { (mode) }
                    td { (settings) }
                    td { (on_front) }
                    td.name.long {
                        @if *on_front == 0 { span.bad { "nowhere" } }
                        @else if on_front == settings { "everywhere" }
                        @else { (at.join("; ")) }
                        @if *disqualified > 0 { " (missed pairs or was not checked in " (disqualified) ")" }
                    }
                }
            }
        } }
        p {
            @if pareto.nowhere.is_empty() { "Every mode is on the front somewhere." }
            @else { "Nowhere on the front: " strong { (pareto.nowhere.join(", ")) } "." }
        }
    }
}

/// Scenes far from the origin of a world in f64: a table of the two ways is clearer than plots.
fn worlds(settings: &[Setting<'_>]) -> Markup {
    let ns = |ns: u64| Unit::Nanoseconds.text(ns as f64);
    let worlds: Vec<_> = settings.iter().filter(|s| s.offset.is_some()).collect();
    html! {
        @if !worlds.is_empty() {
            h2 { "Far from the origin" }
            p {
                "The scene in a world of f64 coordinates, held to the exact overlaps in f64. "
                code { "f64" } " sends boxes relative to an origin among them, rounded outward; "
                code { "plain-f32" } " rounds every coordinate to the nearest f32, and is there as a "
                "warning. Of large scenes it is left out: its pairs would be nearly all there are."
            }
            div.scroll { table.rows {
                tr {
                    th.name { "scene" } th { "boxes" } th { "from the origin" } th.name { "way" }
                    th.name { "engine" } th { "frame p50" } th { "p99" } th { "bytes down" }
                    th { "true pairs" } th { "missed" } th { "extra" } th { "share" }
                }
                @for row in worlds.iter().flat_map(|setting| &setting.rows) {
                    tr {
                        td.name { (row.scene) } td { (row.n) }
                        td { (row.offset.map_or_else(String::new, |offset| format!("{offset:e}"))) }
                        td.name { (row.mode) } td.name { (engine_name(row)) }
                        td { (ns(row.times.total_ns.p50)) } td { (ns(row.times.total_ns.p99)) }
                        td { (Unit::Bytes.text(row.bytes_down as f64)) }
                        (error_cells(row))
                    }
                }
            } }
        }
    }
}

/// The note on how to read the rows of spheres.
fn sphere_note(rows: &[AccuracyRow]) -> Markup {
    html! {
        @if rows.iter().any(|row| row.mode == "spheres") {
            p {
                code { "spheres" } " are culled in the client's process and held to the exact overlaps of "
                "spheres. As stand-ins for boxes, which is what the plots show, their extra pairs are "
                "those that the boxes do not have. Spheres within the boxes lose pairs of boxes, and so "
                "are not on a front."
            }
        }
    }
}

fn mapping_section(rows: &[VariantRow]) -> Markup {
    html! {
        h2 { "From a pair's number to the pair" }
        p {
            "The papers' mapping functions (Avril et al. 2012, §3) and others: time against the share of "
            "numbers that become another pair or none, each of which is a pair missed or tested twice. "
            "None of them serves a client."
        }
        div.plots {
            @for rows in mapping_settings(rows) { (mapping(&rows).draw()) }
        }
        details {
            summary { "All figures" }
            div.scroll { table {
                tr {
                    th.name { "way" } th { "boxes" } th.name { "processor" } th { "time a pair" }
                    th { "wrong" } th { "pairs missed" } th { "rows off" } th { "looked at" }
                }
                @for row in rows {
                    tr {
                        td.name { (row.variant) } td { (row.n) } td.name { (row.processor) }
                        td { (row.ps_per_pair.map_or("-".to_owned(), |ps| Unit::Nanoseconds.text(ps / 1e3))) }
                        td { (percent(row.wrong_share)) }
                        td {
                            @if row.missed_share[0] < row.missed_share[1] { "at most " }
                            (percent(row.missed_share[1]))
                        }
                        td { (row.largest_row_error) }
                        td { (Unit::Count.text(row.ids as f64)) @if row.is_complete { ", all" } }
                    }
                }
            } }
        }
    }
}

fn percent(share: f64) -> String {
    format!("{} %", Unit::Ratio.text(100.0 * share))
}

fn table(rows: &[AccuracyRow]) -> Markup {
    let ns = |ns: u64| Unit::Nanoseconds.text(ns as f64);
    let bytes = |bytes: u64| Unit::Bytes.text(bytes as f64);
    let ratio = |ratio: Option<f64>| ratio.map_or("-".to_owned(), percent);
    let has_spheres = rows.iter().any(|row| row.against_boxes.is_some());
    html! {
        div.scroll { table.rows {
            tr {
                th.name { "scene" } th { "boxes" } th.name { "mode" } th.name { "engine" }
                th { "frame p50" } th { "p99" }
                th { "bytes up" } th { "bytes down" }
                th { "true pairs" } th { "missed" } th { "extra" } th { "share" }
                @if has_spheres { th { "of boxes: missed" } th { "extra" } }
                th { "requests" } th { "memory" }
            }
            @for row in rows {
                tr {
                    td.name { (row.scene) } td { (row.n) } td.name { (row.mode_text()) }
                    td.name { (engine_name(row)) }
                    td { (ns(row.times.total_ns.p50)) } td { (ns(row.times.total_ns.p99)) }
                    td { (bytes(row.bytes_up)) } td { (bytes(row.bytes_down)) }
                    (error_cells(row))
                    @if has_spheres {
                        @if let Some(boxes) = &row.against_boxes {
                            td { (ratio(AccuracyRow::ratio(boxes.missed, boxes.true_pairs))) }
                            td { (ratio(boxes.extra_ratio)) }
                        } @else { td {} td {} }
                    }
                    td { (row.requests) "/" (row.frames) }
                    td { (bytes(row.memory_bytes)) }
                }
            }
        } }
    }
}

/// True, missed and extra pairs, and the extra ones' share, as four cells.
fn error_cells(row: &AccuracyRow) -> Markup {
    html! {
        @if row.checked_frames == 0 {
            @for _ in 0..4 { td { "-" } }
        } @else {
            td { (row.true_pairs) }
            td { @if row.missed == 0 { "0" } @else { span.bad { (row.missed) } } }
            td { (row.extra) }
            td { (row.extra_ratio.map_or("-".to_owned(), percent)) }
        }
    }
}

fn stage_table(rows: &[AccuracyRow]) -> Markup {
    let ns = |ns: u64| Unit::Nanoseconds.text(ns as f64);
    html! {
        details {
            summary { "All stages of all rows" }
            div.scroll { table.rows {
                tr {
                    th.name { "scene" } th { "boxes" } th.name { "mode" } th.name { "engine" }
                    @for (stage, _) in StageTimes::default().by_name() { th { (stage) } }
                }
                @for row in rows {
                    tr {
                        td.name { (row.scene) } td { (row.n) } td.name { (row.mode_text()) }
                        td.name { (row.engine) }
                        @for (_, times) in row.times.by_name() {
                            td { (ns(times.p50)) " / " (ns(times.p99)) }
                        }
                    }
                }
            } }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use crate::study::mapping::stage::Variant;

    use super::*;
    use crate::study::accuracy::rows::{self, Percentiles};
    use crate::study::accuracy::variants;

    pub(in super::super) fn row(mode: &str, p50: u64, extra: u64, missed: u64) -> AccuracyRow {
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

    /// Every way at three sizes on both processors: as many rows as a full study has.
    fn variants() -> Vec<VariantRow> {
        let rows = Variant::all().flat_map(|variant| {
            ["cpu", "gpu"].into_iter().flat_map(move |processor| {
                let name = variant.to_string();
                [1_000, 10_000, 100_000].map(|n| VariantRow {
                    n,
                    processor: processor.to_owned(),
                    ..variants::tests::row(&name, f64::from(n), 1e-4)
                })
            })
        });
        rows.collect()
    }

    fn page(rows: Vec<AccuracyRow>) -> String {
        let mut machine = Machine::here(None);
        "bench <accuracy>".clone_into(&mut machine.command);
        html(&AccuracyReport::new(machine, 7, rows, variants()))
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
        assert!(page.contains(pairmaskd::cli::build::COMMIT));
    }

    #[test]
    fn a_missed_pair_is_told_first_and_keeps_its_mode_off_the_front() {
        let rows = vec![row("exact", 2000, 0, 0), row("q16", 1000, 3, 1), row("q8", 3000, 9, 0)];
        let page = page(rows);
        assert!(page.contains("1 pairs were missed"));
        assert_eq!(page.matches("nowhere</span>").count(), 2);
        assert!(page.contains("<strong>q16, q8</strong>"));
    }

    #[test]
    fn worlds_have_a_table_and_no_empty_plots() {
        let far = |mode: &str| AccuracyRow { offset: Some(1e9), ..row(mode, 2000, 7, 0) };
        let page = page(vec![far("f64"), far("plain-f32")]);
        assert!(page.contains("Far from the origin") && page.contains("1e9"));
        for absent in ["Speed against error", "Scaling", "Percentiles", "Where the time goes"] {
            assert!(!page.contains(absent), "{absent}");
        }
    }

    #[test]
    fn unchecked_frames_are_not_called_right() {
        let page = page(vec![AccuracyRow { checked_frames: 0, ..row("exact", 2000, 0, 0) }]);
        assert!(page.contains("No frame was checked") && !page.contains("No pair was missed"));
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
