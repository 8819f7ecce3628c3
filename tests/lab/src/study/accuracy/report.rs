//! The report as text, as CSV, and as one page of plots and tables that loads nothing.

use serde_json::Value;

use super::judge::{Setting, in_order, p50, pareto, settings, text, title};
use crate::study::harness::Report;
use crate::study::harness::document::Part;
use crate::study::harness::machine::Machine;
use crate::study::harness::plot::{Look, Plot, Series, Unit};
use crate::study::harness::table::{Fields, Table};
use crate::study::papers;

/// The report of these rows.
pub fn report(machine: &Machine, seed: u64, rows: &[Fields]) -> Report {
    let (modes, pareto) = pareto(rows);
    let far: Vec<&Fields> = rows.iter().filter(|row| !row["offset"].is_null()).collect();
    let sections = [
        Part::section(
            "What modes cost",
            "Modes against exact frames of the same scene, size and engine: a time below 1 is faster. \
             Extra pairs are reported though the boxes do not overlap, in percent of the pairs that do. \
             No mode may miss a pair.",
            choices(rows),
        ),
        Part::section(
            "Which mode pays where",
            "A mode is on the Pareto front of a scene, size and distance from the origin if no other one \
             that misses nothing is at least as fast (median of a whole frame), with no more extra pairs \
             and no more bytes up, and better in one of the three. Medians count as they were measured: a \
             nanosecond decides where all else is equal.",
            verdicts(&modes),
        ),
        Part::section(
            "Far from the origin",
            "The scene in a world of f64 coordinates, held to the exact overlaps in f64. `f64` sends \
             boxes relative to an origin among them, rounded outward; `plain-f32` rounds every \
             coordinate to the nearest f32, and is there as a warning. Of large scenes it is left \
             out: its pairs would be nearly all there are.",
            Table::of(&far).only(FAR_COLUMNS),
        ),
        Part::section(
            "All rows",
            "Pairs are those of the checked frames.",
            Table::of(rows).only(COLUMNS),
        ),
    ];
    let title = vec![Part::heading(1, "Run time against error"), Part::text(missed(rows))];
    let mut report = Report::new("accuracy", title);
    report.machine(machine);
    report.parts.push(Part::text(format!("Seed: {seed}.")));
    report.parts.extend(sections.concat());
    report.page = Some(("report.html", plots(rows)));
    report.value("seed", seed);
    report.list("rows", rows);
    report.value("pareto", pareto);
    report
}

const TIME: &str = "times.total_ns.p50";

const COLUMNS: &str = "scene,n,precision,backend,served_by_engine,times.total_ns.p50,\
    times.total_ns.p99,times.fill_ns.p50,times.engine_ns.p50,times.round_trip_ns.p50,\
    times.decode_ns.p50,bytes_up,bytes_down,requests,frames,checked_frames,missed,extra_ratio,\
    against_boxes.missed,against_boxes.extra_ratio,memory_bytes";

/// Of the two ways far from the origin: a table is clearer than plots.
const FAR_COLUMNS: &str = "scene,n,precision,served_by_engine,times.total_ns.p50,\
    times.total_ns.p99,bytes_down,checked_frames,true_pairs,missed,extra,extra_ratio";

/// Stages that share a frame.
const PARTS: [&str; 6] = [
    "times.fill_ns.p50",
    "times.ingest_ns.p50",
    "times.plan_ns.p50",
    "times.execute_ns.p50",
    "times.publish_ns.p50",
    "times.decode_ns.p50",
];

/// Plots of the rows that do not lie far from the origin, and how to read them.
fn plots(rows: &[Fields]) -> Vec<Part> {
    let near: Vec<Fields> = rows.iter().filter(|row| row["offset"].is_null()).cloned().collect();
    let scenes = || in_order(&near, "scene").into_iter();
    let of_scene = |scene: &str| {
        let rows = near.iter().filter(|row| row["scene"] == scene);
        Table::of(&rows.collect::<Vec<_>>())
    };
    let over_n = |y: &[&str]| {
        let of = |scene| {
            let title = format!("{scene}: {}", y.join(", "));
            Plot {
                title,
                ..Plot::of(&of_scene(scene), "n", y, &["precision", "engine"], Look::Line)
            }
        };
        scenes().map(of).collect::<Vec<_>>()
    };
    let sections = [
        (
            "Speed against error",
            "Whole frame (boxes written, pairs found, every pair looked at), median, against extra pairs, \
             %. The dashed line is the front of these two; what missed a pair is not drawn. \
             Spheres are culled in the client's process, and stand for boxes: their extra pairs are \
             those that the boxes do not have.",
            settings(&near).iter().map(speed_against_error).collect(),
        ),
        (
            "Scaling, with the papers beside",
            "The papers' lines are theirs: their scenes, their machines, what they counted as a frame.",
            scenes().map(|scene| scaling(scene, &near)).collect(),
        ),
        ("Percentiles", "Whole frames.", over_n(&[TIME, "times.total_ns.p99"])),
        (
            "Where the time goes",
            "Medians of the stages; they do not add up exactly. What the round trip has beside the \
             engine is the transport and both sides' waiting.",
            over_n(&PARTS),
        ),
    ];
    let shown = sections.into_iter().filter(|(_, _, plots)| !plots.is_empty());
    let parts = |(title, text, plots): (&str, &str, Vec<Plot>)| {
        let plots = plots.iter().map(Plot::svg).collect();
        [Part::heading(2, title), Part::text(text), Part::Plots(plots)]
    };
    shown.flat_map(parts).collect()
}

fn missed(rows: &[Fields]) -> String {
    let sum = |name: &str| rows.iter().filter_map(|row| row[name].as_u64()).sum::<u64>();
    let checked = sum("checked_frames");
    match (checked, sum("missed")) {
        (0, _) => "**No frame was checked**: what is missed and extra is not known.".to_owned(),
        (_, 0) => {
            let pairs = sum("true_pairs");
            let frames = format!("in {checked} checked frames with {pairs} overlapping pairs");
            format!("**No pair was missed** {frames}.")
        }
        (_, missed) => format!("**{missed} pairs were missed** in {checked} checked frames."),
    }
}

fn choices(rows: &[Fields]) -> Table {
    let line = |mode: &str| {
        let its = || rows.iter().filter(|row| row["precision"] == mode);
        let ratios = || its().filter_map(|row| against_exact(row, rows));
        let text = |ratio: Option<f64>| ratio.map_or("-".to_owned(), |x| Unit::Ratio.text(x));
        let errors = its().filter_map(|row| row["error_percent"].as_f64());
        let misses = |found: &Value| found["missed"].as_u64() > Some(0);
        let extra = if its().any(|row| row["missed"] != 0 || misses(&row["against_boxes"])) {
            "misses pairs".to_owned()
        } else {
            text(errors.reduce(f64::max))
        };
        let largest = its().max_by_key(|row| row["n"].as_u64());
        let bytes =
            largest.and_then(|row| row["bytes_up"].as_u64()?.checked_div(row["n"].as_u64()?));
        let (least, most) = (ratios().reduce(f64::min), ratios().reduce(f64::max));
        [mode.to_owned(), text(least), text(most), extra, text(bytes.map(|bytes| bytes as f64))]
    };
    let head = ["mode", "frame time, exact = 1, from", "to", "extra %, at most", "bytes a box"];
    Table::of_texts(head, in_order(rows, "precision").into_iter().map(line))
}

/// Median frame of a row over that of the exact row of its scene, size and engine.
fn against_exact(row: &Fields, rows: &[Fields]) -> Option<f64> {
    let is_its = |other: &&Fields| {
        let is_same = |name: &&str| other[*name] == row[*name];
        other["mode"] == "exact" && ["scene", "n", "engine"].iter().all(is_same)
    };
    let base = p50(rows.iter().find(is_its)?);
    (base > 0.0).then(|| p50(row) / base)
}

fn verdicts(modes: &[Fields]) -> Table {
    let line = |verdict: &Fields| {
        let at: Vec<&str> =
            verdict["at"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let at = match at.len() as u64 {
            0 => "nowhere".to_owned(),
            all if verdict["settings"] == all => "everywhere".to_owned(),
            _ => at.join("; "),
        };
        let [settings, on_front, disqualified] =
            ["settings", "on_front", "disqualified"].map(|name| verdict[name].to_string());
        [text(verdict, "mode").to_owned(), settings, on_front, disqualified, at]
    };
    let head = ["mode", "settings", "on the front", "missed pairs or not checked in", "where"];
    Table::of_texts(head, modes.iter().map(line))
}

fn speed_against_error(setting: &Setting<'_>) -> Plot {
    let plot =
        Plot::of(&Table::of(setting), "error_percent", &[TIME], &["precision"], Look::Points);
    Plot { title: title(setting), ..plot.with_front() }
}

/// Exact frames of a scene over n, a line an engine, beside the papers'.
fn scaling(scene: &str, rows: &[Fields]) -> Plot {
    let exact = rows.iter().filter(|row| row["mode"] == "exact" && row["scene"] == scene);
    let table = Table::of(&exact.collect::<Vec<_>>());
    let mut plot = Plot::of(&table, "n", &[TIME], &["engine", "backend"], Look::Line);
    plot.title = format!("{scene}, exact");
    let papers = papers::lines();
    plot.series.extend(papers.map(|(name, line)| Series::line(name, 0, Look::Others, line)));
    plot
}

#[cfg(test)]
pub(super) mod tests {
    use serde_json::json;

    use super::super::measure::{STAGES, error_percent};
    use super::super::truth::Difference;
    use super::*;
    use crate::study::harness::document::{html, markdown};
    use crate::study::harness::table::{fields, row};

    /// A row of a mode, of 1,000 true pairs.
    pub fn row(precision: &str, p50: u64, extra: u64, missed: u64) -> Fields {
        let found = Difference::of(1000, missed, extra);
        let times = |stage: &'static str| {
            let p50 = if stage == "total_ns" { p50 } else { 0 };
            (stage, json!({"p50": p50, "p99": 2 * p50}))
        };
        let null = Value::Null;
        let mut row = row!(
            scene: "uniform",
            n: 1000,
            mode: precision.split('=').next(),
            margin: null,
            offset: null,
            spheres: null,
            precision,
            backend: "daemon",
            engine: "auto",
            served_by_engine: "cpu-grid",
            frames: 200,
            requests: 40,
            times: std::collections::BTreeMap::from(STAGES.map(times)),
            bytes_up: 24_000,
            bytes_down: 12_000,
            checked_frames: 4,
        );
        row.extend(fields(&found));
        let error_percent = error_percent(4, found, None);
        row.extend(row!(error_percent, against_boxes: null, memory_bytes: 1 << 30));
        row
    }

    fn report_of(rows: &[Fields]) -> Report {
        let command = "bench <accuracy>".to_owned();
        report(&Machine { command, ..Machine::here(None) }, 1, rows)
    }

    fn page_of(rows: &[Fields]) -> String {
        let report = report_of(rows);
        html(&[report.parts, report.page.map(|(_, plots)| plots).unwrap_or_default()].concat())
    }

    #[test]
    fn lines_have_as_many_fields_as_the_head_and_text_all_columns() {
        let mut spheres = row("spheres=circumscribed", 500_000, 0, 0);
        spheres.extend(row!(against_boxes: Difference::of(100, 2, 7)));
        let report = report_of(&[row("margin=0.1", 500_000, 25, 0), spheres]);
        let csv = report.csv();
        let counts: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [44; 3]);
        assert!(csv.contains(",times.total_ns.p50,times.total_ns.p99,"), "{csv}");
        let text = markdown(&report.parts);
        for part in ["margin=0.1", "spheres=circumscribed", "misses pairs", " 0.07 |", "| nowhere"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn a_page_loads_nothing_and_reports_what_was_missed_first() {
        let page = page_of(&[row("exact", 2000, 0, 0), row("q16", 1000, 3, 0)]);
        let without_namespace = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for outside in ["http:", "https:", "src=", "href=", "url(", "@import", "<script"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        // Speed against error, scaling, percentiles and stages of the one setting.
        assert_eq!(page.matches("<svg").count(), 4);
        assert!(page.contains("No pair was missed") && page.contains(">0.5<"), "{page}");
        assert!(page.contains("bench &lt;accuracy&gt;"), "the command is escaped");
        let missing = page_of(&[row("exact", 2000, 0, 0), row("q16", 1000, 3, 1)]);
        assert!(missing.contains("1 pairs were missed") && missing.contains("misses pairs"));
        let mut unchecked = row("exact", 2000, 0, 0);
        unchecked.extend(row!(checked_frames: 0, error_percent: Value::Null));
        let unchecked = page_of(&[unchecked]);
        assert!(unchecked.contains("No frame was checked") && !unchecked.contains("No pair was"));
        let far = |precision: &str| {
            let mut row = row(precision, 2000, 7, 0);
            row.extend(row!(offset: 1e9));
            row
        };
        let page = page_of(&[far("f64=1e9"), far("plain-f32=1e9")]);
        assert!(page.contains("Far from the origin") && page.contains("1e9"));
        for absent in ["Speed against error", "Scaling", "Percentiles", "Where the time goes"] {
            assert!(!page.contains(absent), "{absent}");
        }
    }
}
