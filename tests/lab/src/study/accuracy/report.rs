//! What rows are worth (settings, and the Pareto front), as text, as CSV, and as one page of plots and tables that
//! loads nothing.

use serde_json::Value;

use crate::study::harness::{
    Fields, Part, Plot, Report, Table, number_text, pareto_front, row, value_text,
};

/// The report of these rows.
pub fn report(machine: Fields, seed: u64, rows: &[Fields]) -> Report {
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

/// Plots of the rows that do not lie far from the origin, and how to read them.
fn plots(rows: &[Fields]) -> Vec<Part> {
    let near: Vec<Fields> = rows.iter().filter(|row| row["offset"].is_null()).cloned().collect();
    let against_error = |setting: &Setting<'_>| {
        let table = Table::of(setting);
        let mut plot = Plot::of(&table, "error_percent", TIME, &["precision"]);
        plot.title = title(setting);
        plot.svg()
    };
    let plots: Vec<String> = settings(&near).iter().map(against_error).collect();
    if plots.is_empty() {
        return Vec::new();
    }
    let how_to_read = "Whole frame (boxes written, pairs found, every pair looked at), median, against extra pairs, \
                       %. The dashed line is the front of these two; what missed a pair is not drawn. \
                       Spheres are culled in the client's process, and stand for boxes: their extra pairs are \
                       those that the boxes do not have.";
    vec![Part::heading(2, "Speed against error"), Part::text(how_to_read), Part::Plots(plots)]
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
        // The median frame over that of the exact row of the same scene, size and engine.
        let against_exact = |row: &Fields| {
            let is_same = |other: &Fields, name: &str| other[name] == row[name];
            let is_its = |other: &&Fields| {
                other["mode"] == "exact"
                    && ["scene", "n", "engine"].iter().all(|name| is_same(other, name))
            };
            let base = p50(rows.iter().find(is_its)?);
            (base > 0.0).then(|| p50(row) / base)
        };
        let ratios = || its().filter_map(against_exact);
        let text = |ratio: Option<f64>| ratio.map_or("-".to_owned(), number_text);
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

/// Rows that answer the same question: of one scene, one size and one distance from the origin, in the order in which
/// they were measured. Rows of f32 boxes do not belong to a setting far from the origin.
type Setting<'a> = Vec<&'a Fields>;

fn title(setting: &Setting<'_>) -> String {
    let row = setting[0];
    let far =
        row["offset"].as_f64().map_or_else(String::new, |x| format!(", {x:e} from the origin"));
    let n = value_text("n", row["n"].as_f64().unwrap_or(0.0));
    format!("{}, {n} boxes{far}", text(row, "scene"))
}

fn text<'a>(row: &'a Fields, name: &str) -> &'a str {
    row[name].as_str().unwrap_or_default()
}

/// The median of whole frames, ns.
fn p50(row: &Fields) -> f64 {
    row["times"]["total_ns"]["p50"].as_f64().unwrap_or(0.0)
}

fn settings(rows: &[Fields]) -> Vec<Setting<'_>> {
    let scenes = in_order(rows, "scene");
    let slot = |row: &Fields| {
        let scene = scenes.iter().position(|scene| *scene == text(row, "scene"));
        (scene, row["n"].as_u64())
    };
    let distance = |row: &Fields| row["offset"].as_f64().unwrap_or(-1.0);
    let order =
        |a: &&Fields, b: &&Fields| slot(a).cmp(&slot(b)).then(distance(a).total_cmp(&distance(b)));
    let mut sorted: Vec<&Fields> = rows.iter().collect();
    sorted.sort_by(order);
    let settings = sorted.chunk_by(|a, b| order(a, b).is_eq());
    settings.map(<[_]>::to_vec).collect()
}

/// The different texts of a field, in the order of the rows.
fn in_order<'a>(rows: &'a [Fields], name: &str) -> Vec<&'a str> {
    let mut seen = Vec::new();
    for row in rows {
        if !seen.contains(&text(row, name)) {
            seen.push(text(row, name));
        }
    }
    seen
}

/// The Pareto front of time, extra pairs and bytes: its axes, a row for each mode, and the modes that are nowhere on
/// it, which are beaten in every setting that was measured.
fn pareto(rows: &[Fields]) -> (Vec<Fields>, Fields) {
    let all = settings(rows);
    let costs =
        |row: &Fields| Some([p50(row), row["error_percent"].as_f64()?, row["bytes_up"].as_f64()?]);
    let verdict = |mode: &str| {
        let is_its = |row: &Fields| text(row, "precision") == mode;
        let (mut settings, mut disqualified, mut at) = (0, 0, Vec::new());
        for setting in all.iter().filter(|setting| setting.iter().any(|row| is_its(row))) {
            let (runners, costs): (Vec<_>, Vec<_>) =
                setting.iter().filter_map(|row| Some((*row, costs(row)?))).unzip();
            let mut ranked = runners.iter().zip(pareto_front(&costs));
            settings += 1;
            disqualified += u64::from(!runners.iter().any(|row| is_its(row)));
            at.extend(ranked.any(|(row, wins)| wins && is_its(row)).then(|| title(setting)));
        }
        row!(mode, settings, disqualified, on_front: at.len(), at)
    };
    let modes: Vec<Fields> = in_order(rows, "precision").into_iter().map(verdict).collect();
    let nowhere = modes.iter().filter(|mode| mode["on_front"] == 0);
    let nowhere: Vec<Value> = nowhere.map(|mode| mode["mode"].clone()).collect();
    let pareto = row!(axes: ["p50", "extra_ratio", "bytes_up"], modes, nowhere);
    (modes, pareto)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::measure::error_percent;
    use super::super::truth::Difference;
    use super::*;
    use crate::study::harness::{fields, html, machine_with, markdown};

    /// A row of a mode, of 1,000 true pairs.
    fn measured(precision: &str, p50: u64, extra: u64, missed: u64) -> Fields {
        let found = Difference::of(1000, missed, extra);
        let mut row = row!(
            scene: "uniform",
            n: 1000,
            mode: precision.split('=').next(),
            offset: Value::Null,
            precision,
            engine: "auto",
            times: json!({"total_ns": {"p50": p50, "p99": 2 * p50}}),
            bytes_up: 24_000,
            checked_frames: 4,
        );
        row.extend(fields(&found));
        row.extend(row!(error_percent: error_percent(4, found, None), against_boxes: Value::Null));
        row
    }

    fn report_of(rows: &[Fields]) -> Report {
        let mut machine = machine_with(None);
        machine.extend(row!(command: "bench <accuracy>"));
        report(machine, 1, rows)
    }

    fn page_of(rows: &[Fields]) -> String {
        let report = report_of(rows);
        html(&[report.parts, report.page.map(|(_, plots)| plots).unwrap_or_default()].concat())
    }

    #[test]
    fn the_text_has_all_columns() {
        let mut spheres = measured("spheres=circumscribed", 500_000, 0, 0);
        spheres.extend(row!(against_boxes: Difference::of(100, 2, 7)));
        let text = markdown(&report_of(&[measured("margin=0.1", 500_000, 25, 0), spheres]).parts);
        for part in ["margin=0.1", "spheres=circumscribed", "misses pairs", " 0.07 |", "| nowhere"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn a_page_loads_nothing_and_reports_what_was_missed_first() {
        let page = page_of(&[measured("exact", 2000, 0, 0), measured("q16", 1000, 3, 0)]);
        let without_namespace = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for outside in ["http:", "https:", "src=", "href=", "url(", "@import", "<script"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        assert_eq!(page.matches("<svg").count(), 1, "of the one setting");
        assert!(page.contains("No pair was missed") && page.contains(">0.5<"), "{page}");
        assert!(page.contains("bench &lt;accuracy&gt;"), "the command is escaped");
        let missing = page_of(&[measured("exact", 2000, 0, 0), measured("q16", 1000, 3, 1)]);
        assert!(missing.contains("1 pairs were missed") && missing.contains("misses pairs"));
        let mut unchecked = measured("exact", 2000, 0, 0);
        unchecked.extend(row!(checked_frames: 0, error_percent: Value::Null));
        let unchecked = page_of(&[unchecked]);
        assert!(unchecked.contains("No frame was checked") && !unchecked.contains("No pair was"));
        let far = |precision: &str| {
            let mut row = measured(precision, 2000, 7, 0);
            row.extend(row!(offset: 1e9));
            row
        };
        let page = page_of(&[far("f64=1e9"), far("plain-f32=1e9")]);
        assert!(page.contains("Far from the origin") && page.contains("1e9"));
        assert!(!page.contains("Speed against error"));
    }

    #[test]
    fn modes_that_are_nowhere_on_the_front_are_named() {
        let of = |mode: &str, n: u32, p50, extra, missed, bytes_up: u64| {
            let offset = (mode == "f64=1e9").then_some(1e9);
            let mut row = measured(mode, p50, extra, missed);
            row.extend(row!(n, offset, bytes_up));
            row
        };
        let rows = [
            of("exact", 10, 100, 0, 0, 24),
            of("q16", 10, 120, 3, 0, 12),
            of("q8", 10, 130, 9, 0, 12),
            of("f16", 10, 1, 0, 1, 12),
            of("f64=1e9", 10, 900, 9, 0, 24),
            of("exact", 20, 100, 0, 0, 24),
            of("q16", 20, 90, 0, 0, 12),
        ];
        let (modes, pareto) = pareto(&rows);
        let verdict = |verdict: &Fields| {
            let counts = ["settings", "disqualified", "on_front"];
            (text(verdict, "mode").to_owned(), counts.map(|name| verdict[name].as_u64()))
        };
        let expected = [
            ("exact", [2, 0, 1]),
            ("q16", [2, 0, 2]),
            ("q8", [1, 0, 0]),
            ("f16", [1, 1, 0]),
            ("f64=1e9", [1, 0, 1]),
        ];
        let expected = expected.map(|(mode, counts)| (mode.to_owned(), counts.map(Some)));
        assert_eq!(modes.iter().map(verdict).collect::<Vec<_>>(), expected);
        assert_eq!(modes[0]["at"], serde_json::json!(["uniform, 10 boxes"]));
        assert_eq!(pareto["nowhere"], serde_json::json!(["q8", "f16"]));
    }
}
