//! The report as text, as CSV, and as one page of plots and tables that loads nothing.

use std::collections::BTreeMap;

use serde_json::json;

use super::judge::{ModeVerdict, Setting, costs, in_order, modes, settings};
use super::rows::{AccuracyReport, AccuracyRow, AgainstBoxes, STAGES};
use super::variants::VariantRow;
use crate::study::harness::Report;
use crate::study::harness::document::{Part, html};
use crate::study::harness::plot::{Axis, Bars, Look, Plot, Point, Series, Unit, pareto_front};
use crate::study::harness::table::Table;
use crate::study::papers;

impl Report for AccuracyReport {
    const NAME: &'static str = "accuracy";

    fn parts(&self) -> Vec<Part> {
        let mut parts = vec![Part::heading(1, "Run time against error")];
        parts.extend(self.machine.parts());
        let rows = readable(&self.rows).only(&TEXT_COLUMNS);
        parts.extend(Part::section_of("Rows", "Times are medians, ms.", rows));
        parts.push(Part::text(self.pareto.to_string()));
        let note = "Avril et al. 2012; none serves a client.";
        parts.extend(Part::section("Mapping functions", note, &self.variants));
        parts
    }

    fn tables(&self) -> Vec<(&'static str, Table)> {
        vec![("rows", Table::of(&self.rows))]
    }

    fn files(&self) -> Vec<(String, String)> {
        vec![
            ("accuracy.csv".to_owned(), self.csv()),
            ("mapping.csv".to_owned(), Table::of(&self.variants).csv()),
            ("report.html".to_owned(), html(&page(self))),
        ]
    }
}

/// Columns for a terminal.
const TEXT_COLUMNS: [&str; 18] = [
    "scene",
    "n",
    "mode",
    "backend",
    "engine",
    "p50",
    "p99",
    "fill",
    "engine time",
    "round trip",
    "decode",
    "bytes up",
    "down",
    "requests",
    "missed",
    "extra %",
    "against boxes %",
    "MiB",
];

/// Columns of scenes far from the origin.
const FAR_COLUMNS: [&str; 11] = [
    "scene",
    "n",
    "mode",
    "engine",
    "p50",
    "p99",
    "down",
    "true pairs",
    "missed",
    "extra",
    "extra %",
];

/// The rows for readers.
fn readable(rows: &[AccuracyRow]) -> Table {
    let percent = |x: Option<f64>| x.map(|x| (1e5 * x).round() / 1e3);
    let line = |row: &AccuracyRow| {
        let mut line = json!({
            "scene": row.scene, "n": row.n, "mode": row.mode_text(), "backend": row.backend,
            "engine": row.served_by_engine, "bytes up": row.bytes_up, "down": row.bytes_down,
            "requests": format!("{}/{}", row.requests, row.frames), "MiB": row.memory_bytes >> 20,
            "p50": row.p50() as f64 / 1e6, "p99": row.time("total_ns").p99 as f64 / 1e6,
        });
        for stage in STAGES {
            let name =
                stage.trim_end_matches("_ns").replace('_', " ").replace("engine", "engine time");
            line[name] = (row.time(stage).p50 as f64 / 1e6).into();
        }
        // What nobody looked at is not known.
        if row.checked_frames > 0 {
            line["true pairs"] = row.true_pairs.into();
            line["missed"] = row.missed.into();
            line["extra"] = row.extra.into();
            line["extra %"] = percent(row.extra_ratio).into();
        }
        line["against boxes %"] = row.against_boxes.map(|boxes| against(&boxes)).into();
        line
    };
    Table::of(&rows.iter().map(line).collect::<Vec<_>>())
}

/// Extra and missed pairs against the boxes', in percent.
fn against(boxes: &AgainstBoxes) -> String {
    let text = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{:.3}", 100.0 * x));
    let missed = AccuracyRow::ratio(boxes.missed, boxes.true_pairs).filter(|_| boxes.missed > 0);
    let minus = missed.map_or_else(String::new, |_| format!(" -{}", text(missed)));
    format!("+{}{minus}", text(boxes.extra_ratio))
}

/// The page: plots, tables, and how to read them.
fn page(report: &AccuracyReport) -> Vec<Part> {
    let AccuracyReport { machine, seed, rows, pareto, variants } = report;
    let (settings, modes) = (settings(rows), modes(rows));
    let near: Vec<AccuracyRow> = rows.iter().filter(|row| row.offset.is_none()).cloned().collect();
    let near_settings = || settings.iter().filter(|setting| setting.offset.is_none());
    let mut page = Vec::new();
    let mut add = |title: &str, text: &str, part: Part| {
        page.extend([Part::heading(2, title), Part::text(text), part]);
    };
    add(
        "What to choose",
        "Modes against exact frames of the same scene, size and engine: a time below 1 is faster. \
         Extra pairs are reported though the boxes do not overlap, in percent of the pairs that do. \
         No mode may miss a pair.",
        Part::Table(choices(rows)),
    );
    add(
        "Which mode pays where",
        "A mode is on the Pareto front of a scene, size and distance from the origin if no other one \
         that misses nothing is at least as fast (median of a whole frame), with no more extra pairs \
         and no more bytes up, and better in one of the three. Medians count as they were measured: a \
         nanosecond decides where all else is equal.",
        Part::Table(verdicts(&pareto.modes)),
    );
    if !near.is_empty() {
        add(
            "Speed against error",
            "Whole frame (boxes written, pairs found, every pair looked at), median, against extra \
             pairs. The dashed line is the front of these two; a ring is worth its time only for the \
             bytes that it saves; what is beaten in all three is grey, and what missed a pair is not \
             drawn. Spheres are culled in the client's process and held to the exact overlaps of \
             spheres; as stand-ins for boxes, which is what the plots show, their extra pairs are \
             those that the boxes do not have. Spheres within the boxes lose pairs of boxes, and so \
             are not on a front.",
            Part::Plots(near_settings().map(|s| speed_against_error(s, &modes).svg()).collect()),
        );
    }
    let far: Vec<AccuracyRow> = settings
        .iter()
        .filter(|setting| setting.offset.is_some())
        .flat_map(|setting| setting.rows.iter().copied().cloned())
        .collect();
    if !far.is_empty() {
        // A table of the two ways is clearer than plots.
        add(
            "Far from the origin",
            "The scene in a world of f64 coordinates, held to the exact overlaps in f64. `f64` sends \
             boxes relative to an origin among them, rounded outward; `plain-f32` rounds every \
             coordinate to the nearest f32, and is there as a warning. Of large scenes it is left \
             out: its pairs would be nearly all there are.",
            Part::Table(readable(&far).only(&FAR_COLUMNS)),
        );
    }
    if !near.is_empty() {
        add(
            "Scaling, with the papers beside",
            "The papers' lines are theirs: their scenes, their machines, what they counted as a frame.",
            Part::Plots(scaling(&near).iter().map(Plot::svg).collect()),
        );
        add(
            "Percentiles",
            "Lines through the medians, bars up to the 99th percentiles.",
            Part::Plots(percentiles(&near, &modes).iter().map(Plot::svg).collect()),
        );
        add(
            "Where the time goes",
            "Medians of the stages; medians do not add up exactly. \"The way\" is the round trip \
             without the engine: the transport and both sides' waiting.",
            Part::Plots(near_settings().map(|s| stages(s, &settings).svg()).collect()),
        );
    }
    if !variants.is_empty() {
        add(
            "From a pair's number to the pair",
            "The papers' mapping functions (Avril et al. 2012, §3) and others: time against the share \
             of numbers that become another pair or none, each of which is a pair missed or tested \
             twice. None of them serves a client.",
            Part::Plots(mapping(variants).iter().map(Plot::svg).collect()),
        );
        add("All mapping functions", "", Part::Table(Table::of(variants)));
    }
    add("All rows", "Times are medians, ms.", Part::Table(readable(rows).only(&TEXT_COLUMNS)));
    add("All figures of all rows", "", Part::Table(Table::of(rows)));
    let mut parts = vec![Part::heading(1, "Run time against error"), Part::text(missed(rows))];
    parts.extend(machine.parts());
    parts.push(Part::text(format!("Seed: {seed}.")));
    parts.extend(page);
    parts
}

/// The first sentence of the page.
fn missed(rows: &[AccuracyRow]) -> String {
    let sum = |of: fn(&AccuracyRow) -> u64| rows.iter().map(of).sum::<u64>();
    let [missed, checked, pairs] =
        [sum(|row| row.missed), sum(|row| row.checked_frames), sum(|row| row.true_pairs)];
    match (checked, missed) {
        (0, _) => "**No frame was checked**: what is missed and extra is not known.".to_owned(),
        (_, 0) => {
            format!(
                "**No pair was missed** in {checked} checked frames with {pairs} overlapping pairs."
            )
        }
        _ => format!("**{missed} pairs were missed** in {checked} checked frames."),
    }
}

/// What each kind of mode is for: the case in which it is the one to choose.
const USES: [(&str, &str); 8] = [
    ("exact", "in doubt. No pair is extra, and nothing else is to be known about the scene."),
    (
        "q16",
        "boxes cross a slow link to a GPU and the scene's bounds are known: half the bytes, hardly an extra pair.",
    ),
    (
        "q8",
        "a coarse first filter is enough, and pairs are tested again: a quarter of the bytes, many extra pairs.",
    ),
    ("f16", "as q16 where no bounds are known; finest near the origin."),
    (
        "margin",
        "boxes move little from frame to frame: most frames are answered by the mask of an earlier one.",
    ),
    ("f64", "the world is wider than f32 can tell apart: coordinates in f64, far from the origin."),
    ("plain-f32", "never. It shows what rounding a wide world to f32 does."),
    ("spheres", "objects are round, or tested as spheres anyway."),
];

/// Every mode with its use, beside its cost and gain in these rows.
fn choices(rows: &[AccuracyRow]) -> Table {
    let head = ["choose", "when", "frame time, exact = 1", "extra pairs, at most", "bytes a box"];
    let settings = settings(rows);
    let line = |mode: &String| {
        let its = || rows.iter().filter(|row| row.mode_text() == *mode);
        let kind = its().next().map_or("", |row| row.mode.as_str());
        let mut ratios = Vec::new();
        let (mut faster, mut of) = (0, 0);
        for setting in &settings {
            let here = setting.rows.iter().filter(|row| row.mode_text() == *mode);
            let here: Vec<f64> = here.filter_map(|row| against_exact(row, rows)).collect();
            faster += usize::from(here.iter().any(|ratio| *ratio < 1.0));
            of += usize::from(!here.is_empty());
            ratios.extend(here);
        }
        let mut when =
            USES.iter().find(|(of_it, _)| *of_it == kind).map_or("", |use_| use_.1).to_owned();
        if kind != "exact" && of > 0 {
            let scenes = if of == 1 { "scene" } else { "scenes and sizes" };
            when = format!("{when} Here it is faster than exact in {faster} of {of} {scenes}.");
        }
        ratios.sort_by(f64::total_cmp);
        let text = |ratio: &f64| Unit::Ratio.text(*ratio);
        let time = match (kind, &ratios[..]) {
            ("exact", _) => "1".to_owned(),
            (_, []) => "-".to_owned(),
            (_, [one]) => text(one),
            (_, [least, .., most]) if text(least) == text(most) => text(least),
            (_, [least, .., most]) => format!("{} to {}", text(least), text(most)),
        };
        let errors = its().filter_map(AccuracyRow::error).max_by(f64::total_cmp);
        let extra = match errors {
            _ if its().any(|row| row.missed_of_boxes() > 0) => "misses pairs".to_owned(),
            None => "not known".to_owned(),
            Some(0.0) => "none".to_owned(),
            Some(extra) => percent(extra),
        };
        let largest = its().max_by_key(|row| row.n);
        let bytes = largest.and_then(|row| row.bytes_up.checked_div(u64::from(row.n)));
        [mode.clone(), when, time, extra, bytes.map_or("-".to_owned(), |b| b.to_string())]
    };
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
        let at = match verdict.on_front {
            0 => "nowhere".to_owned(),
            on_front if on_front == verdict.settings => "everywhere".to_owned(),
            _ => verdict.at.join("; "),
        };
        let at = match verdict.disqualified {
            0 => at,
            n => format!("{at} (missed pairs or was not checked in {n})"),
        };
        [verdict.mode.clone(), verdict.settings.to_string(), verdict.on_front.to_string(), at]
    };
    let head = ["mode", "scenes and sizes", "on the front", "where"];
    Table::of_texts(head, modes.iter().map(line))
}

fn percent(share: f64) -> String {
    format!("{} %", Unit::Ratio.text(100.0 * share))
}

/// A plot of times, or of times a pair.
fn plot(title: String, x: Axis, y: &str, series: Vec<Series>) -> Plot {
    Plot { title, x, y: Axis::new(y, Unit::Nanoseconds), series, level: None }
}

/// Points with their Pareto front: what is beaten on both axes and by the hidden cost is grey, what the hidden cost
/// alone saves is a ring. The front is a staircase: between two of its points the left one is the best known.
fn with_front(groups: Vec<Series>, hidden: &[f64]) -> Vec<Series> {
    let all: Vec<[f64; 2]> =
        groups.iter().flat_map(|group| &group.points).map(|point| [point.x, point.y]).collect();
    let costs: Vec<[f64; 3]> = all.iter().zip(hidden).map(|([x, y], h)| [*x, *y, *h]).collect();
    let mut standings = pareto_front(&all).into_iter().zip(pareto_front(&costs));
    let mut front = Vec::new();
    let mut series = Vec::new();
    for mut group in groups {
        for (point, (on_line, wins)) in group.points.iter_mut().zip(&mut standings) {
            point.is_faded = !wins;
            point.is_hollow = wins && !on_line;
            front.extend(on_line.then_some((point.x, point.y)));
        }
        series.push(group);
    }
    front.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut corners: Vec<(f64, f64)> = Vec::new();
    for (x, y) in front {
        corners.extend(corners.last().map(|(_, above)| (x, *above)));
        corners.push((x, y));
    }
    series.insert(0, Series::line("", 0, Look::Front, &corners));
    series
}

/// Speed against error in one setting. Bytes up are the hidden cost. `all` are the modes of the report,
/// which give each its colour.
fn speed_against_error(setting: &Setting<'_>, all: &[String]) -> Plot {
    let mut hidden = Vec::new();
    let mut groups = Vec::new();
    for (colour, mode) in all.iter().enumerate() {
        let mut points = Vec::new();
        for row in setting.rows.iter().filter(|row| row.mode_text() == *mode) {
            let Some([y, x, bytes]) = costs(row) else { continue };
            points.push(Point { x, y, tag: mode.clone(), ..Point::default() });
            hidden.push(bytes);
        }
        if !points.is_empty() {
            groups.push(Series { name: mode.clone(), colour, look: Look::Points, points });
        }
    }
    let x = Axis::new("extra pairs for each true pair", Unit::Ratio);
    plot(setting.title(), x, "whole frame, p50", with_front(groups, &hidden))
}

/// Families of the papers' mapping functions, by the beginnings of their names. The others search, fold
/// or divide, with integers alone.
const FAMILIES: [(&str, &str); 6] = [
    ("closed sqrt", "square root"),
    ("closed carmack", "Carmack's root"),
    ("closed lomont", "Lomont's root"),
    ("closed integer", "root of an integer"),
    ("far-end", "root from the far end"),
    ("", "integers alone"),
];

/// Speed against error of the ways to turn a pair's number into the pair: a plot for each n and processor.
fn mapping(rows: &[VariantRow]) -> Vec<Plot> {
    let mut settings: BTreeMap<(&str, u32), Vec<&VariantRow>> = BTreeMap::new();
    for row in rows {
        settings.entry((&row.processor, row.n)).or_default().push(row);
    }
    let drawn = |((processor, n), rows): ((&str, u32), Vec<&VariantRow>)| {
        let family = |row: &VariantRow| {
            FAMILIES.iter().position(|(start, _)| row.variant.starts_with(start))
        };
        let group = |(colour, (_, name)): (usize, &(&str, &str))| {
            let its = rows.iter().filter(|row| family(row) == Some(colour));
            let point = |row: &&VariantRow| {
                let (x, y) = (row.wrong_share, row.ps_per_pair? / 1e3);
                Some(Point { x, y, tag: row.variant.clone(), ..Point::default() })
            };
            let points = its.filter_map(point).collect();
            Series { name: (*name).to_owned(), colour, look: Look::Points, points }
        };
        let groups: Vec<Series> = FAMILIES.iter().enumerate().map(group).collect();
        let processor = if processor == "gpu" { "GPU" } else { "one thread of the CPU" };
        let title = format!("{} boxes, {processor}", Unit::Count.text(f64::from(n)));
        let x = Axis::new("share of pair numbers that become another pair", Unit::Ratio);
        let mut series = with_front(groups, &vec![0.0; rows.len()]);
        // Names beside all of them would hide the points.
        let points = series.iter_mut().flat_map(|series| &mut series.points);
        points.filter(|point| point.is_faded).for_each(|point| point.tag.clear());
        plot(title, x, "time a pair", series)
    };
    settings.into_iter().map(drawn).collect()
}

/// Points over n, in order.
fn over_n<'a>(
    rows: impl Iterator<Item = &'a AccuracyRow>,
    high: impl Fn(&AccuracyRow) -> Option<f64>,
) -> Vec<Point> {
    let point = |row: &AccuracyRow| {
        let (x, y) = (f64::from(row.n), row.p50() as f64);
        Point { x, y, high: high(row), ..Point::default() }
    };
    let mut points: Vec<Point> = rows.map(point).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points
}

/// Exact frames of each scene over n, a line an engine, beside the papers'.
fn scaling(rows: &[AccuracyRow]) -> Vec<Plot> {
    let exact = || rows.iter().filter(|row| row.mode == "exact");
    let drawn = |scene: &str| {
        let engine = |row: &AccuracyRow| format!("{}, {}", row.engine, row.backend);
        let here = || exact().filter(|row| row.scene == scene);
        let engines = in_order(here().map(engine)).into_iter().enumerate();
        let ours = engines.map(|(colour, name)| {
            let points = over_n(here().filter(|row| engine(row) == name), |_| None);
            Series { name, colour, look: Look::Line, points }
        });
        let papers = papers::lines().map(|(name, line)| Series::line(name, 0, Look::Others, line));
        let x = Axis::new("boxes", Unit::Count);
        plot(format!("{scene}, exact"), x, "whole frame, p50", ours.chain(papers).collect())
    };
    in_order(exact().map(|row| row.scene.as_str())).into_iter().map(drawn).collect()
}

/// Percentiles of each scene over n by each engine, a line a mode with a bar up from each point. `all` are the modes
/// of the report, which give each its colour.
fn percentiles(rows: &[AccuracyRow], all: &[String]) -> Vec<Plot> {
    let key = |row: &AccuracyRow| (row.scene.clone(), row.engine.clone());
    let drawn = |(scene, engine): (String, String)| {
        let line = |(colour, mode): (usize, &String)| {
            let its = rows.iter().filter(|row| {
                row.scene == scene && row.engine == engine && row.mode_text() == *mode
            });
            let points = over_n(its, |row| Some(row.time("total_ns").p99 as f64));
            Series { name: mode.clone(), colour, look: Look::Line, points }
        };
        let lines = all.iter().enumerate().map(line).filter(|line| !line.points.is_empty());
        let (title, x) = (format!("{scene}, engine {engine}"), Axis::new("boxes", Unit::Count));
        plot(title, x, "whole frame, p50 to p99", lines.collect())
    };
    in_order(rows.iter().map(key)).into_iter().map(drawn).collect()
}

/// Medians of the stages in one setting, a bar for every row. The bars of the same scene in f64,
/// far from the origin, follow below. Plain rounding is left out: it is no valid mode, and its bars
/// would dwarf the others.
fn stages(setting: &Setting<'_>, all: &[Setting<'_>]) -> Bars {
    let is_same = |other: &&Setting<'_>| (other.scene, other.n) == (setting.scene, setting.n);
    let far = all.iter().filter(is_same).filter(|other| other.offset.is_some());
    let far = far.flat_map(|other| &other.rows).filter(|row| row.mode == "f64");
    let bar = |row: &&AccuracyRow| {
        let p50 = |stage: &str| row.time(stage).p50;
        let way = p50("round_trip_ns").saturating_sub(p50("engine_ns"));
        let mut values: Vec<f64> = STAGES[..5].iter().map(|stage| p50(stage) as f64).collect();
        values.extend([way, p50("decode_ns")].map(|ns| ns as f64));
        (format!("{} {}", row.mode_text(), row.engine), values)
    };
    let parts = ["fill", "ingest", "plan", "execute", "publish", "the way", "decode"];
    Bars {
        title: setting.title(),
        parts: parts.map(str::to_owned).to_vec(),
        unit: Unit::Nanoseconds,
        bars: setting.rows.iter().chain(far).map(bar).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::accuracy::rows::tests::{of_mode, report, row};
    use crate::study::accuracy::variants;
    use crate::study::harness::document::markdown;

    fn page_of(rows: Vec<AccuracyRow>) -> String {
        let mut report = report(rows);
        report.variants = vec![variants::tests::row("lazy", 1.5, 0.0)];
        "bench <accuracy>".clone_into(&mut report.machine.command);
        html(&page(&report))
    }

    #[test]
    fn lines_have_as_many_fields_as_the_head_and_text_all_columns() {
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
        let csv = report.csv();
        let counts: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [42; 3]);
        assert!(csv.contains(",times.total_ns.p50,times.total_ns.p99,"), "{csv}");
        let text = markdown(&report.parts());
        for part in [
            "margin=0.1",
            "40/200",
            "spheres=inscribed",
            "+7.000 -2.000",
            "lazy",
            "Nowhere on it: spheres",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn a_page_loads_nothing_and_says_what_it_ran_on() {
        let page = page_of(vec![of_mode("exact", 2000, 0, 0), of_mode("q16", 1000, 3, 0)]);
        let without_namespace = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for outside in ["http:", "https:", "src=", "href=", "url(", "@import", "<script"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        // Speed against error, scaling, percentiles and stages of the one setting; the mapping functions.
        assert_eq!(page.matches("<svg").count(), 5);
        assert!(page.contains("No pair was missed"));
        assert!(page.contains("bench &lt;accuracy&gt;"), "the command is escaped");
        assert!(page.contains(pairmaskd::cli::build::COMMIT));
    }

    #[test]
    fn a_missed_pair_is_told_first_and_worlds_have_a_table_and_no_empty_plots() {
        let rows = vec![of_mode("exact", 2000, 0, 0), of_mode("q16", 1000, 3, 1)];
        assert!(page_of(rows).contains("1 pairs were missed"));
        let unchecked = AccuracyRow { checked_frames: 0, ..of_mode("exact", 2000, 0, 0) };
        let unchecked = page_of(vec![unchecked]);
        assert!(unchecked.contains("No frame was checked") && !unchecked.contains("No pair was"));
        let far = |mode: &str| AccuracyRow { offset: Some(1e9), ..of_mode(mode, 2000, 7, 0) };
        let page = page_of(vec![far("f64"), far("plain-f32")]);
        assert!(page.contains("Far from the origin") && page.contains("1e9"));
        for absent in ["Speed against error", "Scaling", "Percentiles", "Where the time goes"] {
            assert!(!page.contains(absent), "{absent}");
        }
    }

    #[test]
    fn a_mode_is_held_against_exact_frames_of_its_scene_size_and_engine() {
        let large = |mode: &str, p50| AccuracyRow { n: 5000, ..of_mode(mode, p50, 5, 0) };
        let rows = [
            of_mode("exact", 2000, 0, 0),
            of_mode("q16", 1000, 3, 0),
            large("exact", 1000),
            large("q16", 1500),
            of_mode("q8", 4000, 3, 2),
        ];
        let text = choices(&rows).markdown();
        for part in ["misses pairs", "0.5 to 1.5", "faster than exact in 1 of 2", "in doubt"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn beaten_points_are_grey_and_the_front_passes_the_others() {
        let points = [(0.0, 100.0), (0.1, 200.0), (0.1, 300.0), (0.2, 50.0)];
        let group = Series::line("g", 0, Look::Points, &points);
        let [front, group] = &with_front(vec![group], &[9.0, 9.0, 8.0, 9.0])[..] else { panic!() };
        let marks: Vec<_> = group.points.iter().map(|p| (p.is_faded, p.is_hollow)).collect();
        assert_eq!(marks, [(false, false), (true, false), (false, true), (false, false)]);
        let corners: Vec<_> = front.points.iter().map(|p| (p.x, p.y)).collect();
        assert_eq!(corners, [(0.0, 100.0), (0.2, 100.0), (0.2, 50.0)]);
    }
}
