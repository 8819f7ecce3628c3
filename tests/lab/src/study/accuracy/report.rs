//! The report as text, as CSV, and as one page of plots and tables that loads nothing.

use serde_json::json;

use super::judge::{ModeVerdict, Pareto, Setting, in_order, modes, settings, title};
use super::rows::{AccuracyRow, STAGES};
use super::truth::Difference;
use crate::study::harness::Report;
use crate::study::harness::document::Part;
use crate::study::harness::machine::Machine;
use crate::study::harness::plot::{Look, Plot, Series, Unit};
use crate::study::harness::table::Table;
use crate::study::papers;

/// The report of these rows.
pub fn report(machine: &Machine, seed: u64, rows: &[AccuracyRow]) -> Report {
    let pareto = Pareto::of(rows);
    let far: Vec<AccuracyRow> = rows.iter().filter(|row| row.offset.is_some()).cloned().collect();
    // A table of the two ways is clearer than plots.
    let columns = "scene,n,mode,engine,p50,p99,down,true pairs,missed,extra,extra %";
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
            verdicts(&pareto.modes),
        ),
        Part::section(
            "Far from the origin",
            "The scene in a world of f64 coordinates, held to the exact overlaps in f64. `f64` sends \
             boxes relative to an origin among them, rounded outward; `plain-f32` rounds every \
             coordinate to the nearest f32, and is there as a warning. Of large scenes it is left \
             out: its pairs would be nearly all there are.",
            readable(&far).only(columns),
        ),
        Part::section("All rows", "Times are medians, ms.", readable(rows).only(TEXT_COLUMNS)),
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

const TEXT_COLUMNS: &str = "scene,n,mode,backend,engine,p50,p99,fill,engine time,round trip,decode,\
    bytes up,down,requests,missed,extra %,against boxes %,MiB";

/// Stages that share a frame.
const PARTS: [&str; 6] = ["fill", "ingest", "plan", "execute", "publish", "decode"];

fn readable(rows: &[AccuracyRow]) -> Table {
    let percent = |x: Option<f64>| x.map(|x| (1e5 * x).round() / 1e3);
    let line = |row: &AccuracyRow| {
        let mut line = json!({
            "scene": row.scene, "n": row.n, "mode": row.mode_text(), "backend": row.backend,
            "engine": row.served_by_engine, "asked": row.engine, "bytes up": row.bytes_up,
            "down": row.bytes_down, "requests": format!("{}/{}", row.requests, row.frames),
            "MiB": row.memory_bytes >> 20, "p50": row.p50() as f64 / 1e6,
            "p99": row.time("total_ns").p99 as f64 / 1e6,
            // What missed a pair of the boxes, or was not checked, is not drawn.
            "error %": percent(row.error()),
        });
        for stage in STAGES {
            let name =
                stage.trim_end_matches("_ns").replace('_', " ").replace("engine", "engine time");
            line[name] = (row.time(stage).p50 as f64 / 1e6).into();
        }
        // What nobody looked at is not known.
        if row.checked_frames > 0 {
            line["true pairs"] = row.found.true_pairs.into();
            line["missed"] = row.found.missed.into();
            line["extra"] = row.found.extra.into();
            line["extra %"] = percent(row.found.extra_ratio).into();
        }
        line["against boxes %"] = row.against_boxes.map(|boxes| against(&boxes)).into();
        line
    };
    Table::of(&rows.iter().map(line).collect::<Vec<_>>())
}

fn against(boxes: &Difference) -> String {
    let text = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{:.3}", 100.0 * x));
    let missed = boxes.missed as f64 / boxes.true_pairs as f64;
    let minus = if boxes.missed > 0 { format!(" -{}", text(Some(missed))) } else { String::new() };
    format!("+{}{minus}", text(boxes.extra_ratio))
}

/// Plots of the rows that do not lie far from the origin, and how to read them.
fn plots(rows: &[AccuracyRow]) -> Vec<Part> {
    let near: Vec<AccuracyRow> = rows.iter().filter(|row| row.offset.is_none()).cloned().collect();
    let scenes = || in_order(near.iter().map(|row| row.scene.as_str())).into_iter();
    let over_n = |y: &[&str]| {
        let of = |scene| {
            let here = near.iter().filter(|row| row.scene == scene).cloned();
            let table = readable(&here.collect::<Vec<_>>());
            let title = format!("{scene}: {}", y.join(", "));
            Plot { title, ..Plot::of(&table, "n", y, &["mode", "asked"], Look::Line) }
        };
        scenes().map(of).collect::<Vec<_>>()
    };
    let sections = [
        (
            "Speed against error",
            "Whole frame (boxes written, pairs found, every pair looked at), median, ms, against extra \
             pairs, %. The dashed line is the front of these two; what missed a pair is not drawn. \
             Spheres are culled in the client's process, and stand for boxes: their extra pairs are \
             those that the boxes do not have.",
            settings(&near).iter().map(speed_against_error).collect(),
        ),
        (
            "Scaling, with the papers beside",
            "The papers' lines are theirs: their scenes, their machines, what they counted as a frame. ms.",
            scenes().map(|scene| scaling(scene, &near)).collect(),
        ),
        ("Percentiles", "Whole frames, ms.", over_n(&["p50", "p99"])),
        (
            "Where the time goes",
            "Medians of the stages, ms; they do not add up exactly. What the round trip has beside the \
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

fn missed(rows: &[AccuracyRow]) -> String {
    let sum = |of: fn(&AccuracyRow) -> u64| rows.iter().map(of).sum::<u64>();
    let checked = sum(|row| row.checked_frames);
    match (checked, sum(|row| row.found.missed)) {
        (0, _) => "**No frame was checked**: what is missed and extra is not known.".to_owned(),
        (_, 0) => {
            let pairs = sum(|row| row.found.true_pairs);
            let frames = format!("in {checked} checked frames with {pairs} overlapping pairs");
            format!("**No pair was missed** {frames}.")
        }
        (_, missed) => format!("**{missed} pairs were missed** in {checked} checked frames."),
    }
}

fn choices(rows: &[AccuracyRow]) -> Table {
    let line = |mode: &String| {
        let its = || rows.iter().filter(|row| row.mode_text() == *mode);
        let ratios = || its().filter_map(|row| against_exact(row, rows));
        let text = |ratio: Option<f64>| ratio.map_or("-".to_owned(), |x| Unit::Ratio.text(x));
        let errors = its().filter_map(AccuracyRow::error).max_by(f64::total_cmp);
        let extra = if its().any(|row| row.missed_of_boxes() > 0) {
            "misses pairs".to_owned()
        } else {
            text(errors.map(|share| 100.0 * share))
        };
        let largest = its().max_by_key(|row| row.n);
        let bytes = largest.and_then(|row| row.bytes_up.checked_div(u64::from(row.n)));
        let (least, most) = (ratios().reduce(f64::min), ratios().reduce(f64::max));
        [mode.clone(), text(least), text(most), extra, text(bytes.map(|bytes| bytes as f64))]
    };
    let head = ["mode", "frame time, exact = 1, from", "to", "extra %, at most", "bytes a box"];
    Table::of_texts(head, modes(rows).iter().map(line))
}

/// Median frame of a row over that of the exact row of its scene, size and engine.
fn against_exact(row: &AccuracyRow, rows: &[AccuracyRow]) -> Option<f64> {
    let is_its = |other: &&AccuracyRow| {
        other.mode == "exact"
            && (&other.scene, other.n, &other.engine) == (&row.scene, row.n, &row.engine)
    };
    let base = rows.iter().find(is_its)?.p50();
    (base > 0).then(|| row.p50() as f64 / base as f64)
}

fn verdicts(modes: &[ModeVerdict]) -> Table {
    let line = |verdict: &ModeVerdict| {
        let ModeVerdict { mode, settings, disqualified, on_front, at } = verdict;
        let at = match *on_front {
            0 => "nowhere".to_owned(),
            on_front if on_front == *settings => "everywhere".to_owned(),
            _ => at.join("; "),
        };
        let numbers = [settings, on_front, disqualified].map(u64::to_string);
        let [settings, on_front, disqualified] = numbers;
        [mode.clone(), settings, on_front, disqualified, at]
    };
    let head = ["mode", "settings", "on the front", "missed pairs or not checked in", "where"];
    Table::of_texts(head, modes.iter().map(line))
}

fn speed_against_error(setting: &Setting<'_>) -> Plot {
    let rows: Vec<AccuracyRow> = setting.iter().copied().cloned().collect();
    let plot = Plot::of(&readable(&rows), "error %", &["p50"], &["mode"], Look::Points);
    Plot { title: title(setting), ..plot.with_front() }
}

/// Exact frames of a scene over n, a line an engine, beside the papers'.
fn scaling(scene: &str, rows: &[AccuracyRow]) -> Plot {
    let exact = rows.iter().filter(|row| row.mode == "exact" && row.scene == scene).cloned();
    let table = readable(&exact.collect::<Vec<_>>());
    let mut plot = Plot::of(&table, "n", &["p50"], &["asked", "backend"], Look::Line);
    plot.title = format!("{scene}, exact");
    plot.series.extend(papers::lines().map(|(name, line)| {
        let line: Vec<_> = line.iter().map(|(n, ns)| (*n, ns / 1e6)).collect();
        Series::line(name, 0, Look::Others, &line)
    }));
    plot
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::accuracy::rows::tests::{of_mode, row};
    use crate::study::harness::document::{html, markdown};

    fn report_of(rows: &[AccuracyRow]) -> Report {
        let command = "bench <accuracy>".to_owned();
        report(&Machine { command, ..Machine::here(None) }, 1, rows)
    }

    fn page_of(rows: &[AccuracyRow]) -> String {
        let report = report_of(rows);
        html(&[report.parts, report.page.map(|(_, plots)| plots).unwrap_or_default()].concat())
    }

    #[test]
    fn lines_have_as_many_fields_as_the_head_and_text_all_columns() {
        let boxes = Difference::of(100, 2, 7);
        let spheres = AccuracyRow {
            margin: None,
            spheres: Some("circumscribed".to_owned()),
            found: Difference { extra_ratio: None, ..Difference::NONE },
            against_boxes: Some(boxes),
            ..of_mode("spheres", 500_000, 0, 0)
        };
        let report = report_of(&[row(), spheres]);
        let csv = report.csv();
        let counts: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [42; 3]);
        assert!(csv.contains(",times.total_ns.p50,times.total_ns.p99,"), "{csv}");
        let text = markdown(&report.parts);
        for part in ["margin=0.1", "40/200", "spheres=circumscribed", "+7.000 -2.000", "| nowhere"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn a_page_loads_nothing_and_reports_what_was_missed_first() {
        let page = page_of(&[of_mode("exact", 2000, 0, 0), of_mode("q16", 1000, 3, 0)]);
        let without_namespace = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for outside in ["http:", "https:", "src=", "href=", "url(", "@import", "<script"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        // Speed against error, scaling, percentiles and stages of the one setting.
        assert_eq!(page.matches("<svg").count(), 4);
        assert!(page.contains("No pair was missed") && page.contains(">0.5<"), "{page}");
        assert!(page.contains("bench &lt;accuracy&gt;"), "the command is escaped");
        let missing = page_of(&[of_mode("exact", 2000, 0, 0), of_mode("q16", 1000, 3, 1)]);
        assert!(missing.contains("1 pairs were missed") && missing.contains("misses pairs"));
        let unchecked = AccuracyRow { checked_frames: 0, ..of_mode("exact", 2000, 0, 0) };
        let unchecked = page_of(&[unchecked]);
        assert!(unchecked.contains("No frame was checked") && !unchecked.contains("No pair was"));
        let far = |mode: &str| AccuracyRow { offset: Some(1e9), ..of_mode(mode, 2000, 7, 0) };
        let page = page_of(&[far("f64"), far("plain-f32")]);
        assert!(page.contains("Far from the origin") && page.contains("1e9"));
        for absent in ["Speed against error", "Scaling", "Percentiles", "Where the time goes"] {
            assert!(!page.contains(absent), "{absent}");
        }
    }
}
