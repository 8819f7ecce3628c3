//! Plots from rows.

use std::collections::BTreeMap;

use pairmaskd::plot::{Bar, Bars, Group, Line, Lines, Point, Points, Range, Ranges, Unit};

use crate::study::accuracy::pareto::costs;
use crate::study::accuracy::rows::AccuracyRow;
use crate::study::accuracy::setting::Setting;
use crate::study::accuracy::variants::VariantRow;

use super::papers;

/// A row's engine and where it ran.
pub(super) fn engine_name(row: &AccuracyRow) -> String {
    let answered = if row.engine == row.served_by_engine {
        row.engine.clone()
    } else {
        format!("{} ({})", row.engine, row.served_by_engine)
    };
    format!("{answered}, {}", row.backend)
}

/// A row's mode and engine, for tooltips.
fn row_name(row: &AccuracyRow) -> String {
    format!("{}, {}", row.mode_text(), engine_name(row))
}

/// Speed against error in one setting. Bytes up are the hidden cost. `all` are the modes of the report,
/// which give each its colour.
pub(super) fn speed_against_error(setting: &Setting<'_>, all: &[String]) -> Points {
    let group = |(series, mode): (usize, &String)| {
        let of_mode = setting.rows.iter().filter(|row| row.mode_text() == *mode);
        let points: Vec<Point> = of_mode
            .filter_map(|row| {
                let [y, x, hidden] = costs(row)?;
                let bytes = Unit::Bytes.text(hidden);
                let label = format!("{}, {bytes} up", row_name(row));
                Some(Point { x, y, hidden, tag: mode.clone(), label })
            })
            .collect();
        (!points.is_empty()).then(|| Group { name: mode.clone(), series, points })
    };
    Points {
        title: setting.title(),
        x_label: "extra pairs for each true pair".to_owned(),
        y_label: "whole frame, p50".to_owned(),
        x_unit: Unit::Ratio,
        y_unit: Unit::Nanoseconds,
        groups: all.iter().enumerate().filter_map(group).collect(),
    }
}

/// Families of the papers' mapping functions, by the beginnings of their names. The others search, fold
/// or divide, with integers alone.
const FAMILIES: [(&str, &str); 5] = [
    ("closed sqrt", "square root"),
    ("closed carmack", "Carmack's root"),
    ("closed lomont", "Lomont's root"),
    ("closed integer", "root of an integer"),
    ("far-end", "root from the far end"),
];
const INTEGERS: &str = "integers alone";

/// Speed against error of the ways to turn a pair's number into the pair: one n on one processor.
pub(super) fn mapping(rows: &[&VariantRow]) -> Points {
    let family = |row: &VariantRow| {
        let known = FAMILIES.iter().find(|(start, _)| row.variant.starts_with(start));
        known.map_or(INTEGERS, |(_, name)| name)
    };
    let names = FAMILIES.iter().map(|(_, name)| *name).chain([INTEGERS]);
    let group = |(series, name): (usize, &str)| {
        let point = |row: &&VariantRow| {
            Some(Point {
                x: row.wrong_share,
                y: row.ps_per_pair? / 1e3,
                hidden: 0.0,
                tag: row.variant.clone(),
                label: row.variant.clone(),
            })
        };
        let points: Vec<Point> =
            rows.iter().filter(|row| family(row) == name).filter_map(point).collect();
        (!points.is_empty()).then(|| Group { name: name.to_owned(), series, points })
    };
    let title = rows.first().map_or_else(String::new, |row| {
        let processor = if row.processor == "gpu" { "GPU" } else { "one thread of the CPU" };
        format!("{} boxes, {processor}", Unit::Count.text(f64::from(row.n)))
    });
    Points {
        title,
        x_label: "share of pair numbers that become another pair".to_owned(),
        y_label: "time a pair".to_owned(),
        x_unit: Unit::Ratio,
        y_unit: Unit::Nanoseconds,
        groups: names.enumerate().filter_map(group).collect(),
    }
}

/// Rows of the mapping functions by processor and n.
pub(super) fn mapping_settings(rows: &[VariantRow]) -> Vec<Vec<&VariantRow>> {
    let mut settings: BTreeMap<(&str, u32), Vec<&VariantRow>> = BTreeMap::new();
    for row in rows {
        settings.entry((&row.processor, row.n)).or_default().push(row);
    }
    settings.into_values().collect()
}

/// Medians of the stages in one setting, a bar for every row. The bars of the same scene in f64,
/// far from the origin, follow below. Plain rounding is left out: it is no valid mode, and its bars
/// would dwarf the others.
pub(super) fn stages(setting: &Setting<'_>, all: &[Setting<'_>]) -> Bars {
    let is_same = |other: &&Setting<'_>| (other.scene, other.n) == (setting.scene, setting.n);
    let far = all.iter().filter(is_same).filter(|other| other.offset.is_some());
    let far = far.flat_map(|other| &other.rows).filter(|row| row.mode == "f64");
    let parts = ["fill", "ingest", "plan", "execute", "publish", "the way", "decode"];
    let bars = setting
        .rows
        .iter()
        .chain(far)
        .map(|row| {
            let t = &row.times;
            let way = t.round_trip_ns.p50.saturating_sub(t.engine_ns.p50);
            let values = [
                t.fill_ns.p50,
                t.ingest_ns.p50,
                t.plan_ns.p50,
                t.execute_ns.p50,
                t.publish_ns.p50,
                way,
                t.decode_ns.p50,
            ];
            Bar {
                name: format!("{} {}", row.mode_text(), row.engine),
                values: values.map(|ns| ns as f64).to_vec(),
            }
        })
        .collect();
    Bars {
        title: setting.title(),
        parts: parts.map(str::to_owned).to_vec(),
        unit: Unit::Nanoseconds,
        bars,
    }
}

/// Rows of one line of a plot over n.
fn over_n<T>(rows: &[&AccuracyRow], y: impl Fn(&AccuracyRow) -> T) -> Vec<(f64, T)> {
    let mut points: Vec<(f64, T)> = rows.iter().map(|row| (f64::from(row.n), y(row))).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// The papers' lines.
pub(super) fn paper_lines() -> Vec<Line> {
    papers::LINES
        .iter()
        .map(|line| Line { name: line.name.to_owned(), points: line.points.to_vec() })
        .collect()
}

/// Exact frames of one scene over n, a line an engine.
pub(super) fn scaling(scene: &str, rows: &[AccuracyRow]) -> Lines {
    let mut series: BTreeMap<String, Vec<&AccuracyRow>> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.scene == scene && row.mode == "exact") {
        series.entry(format!("{}, {}", row.engine, row.backend)).or_default().push(row);
    }
    let line = |(name, rows): (String, Vec<&AccuracyRow>)| Line {
        name,
        points: over_n(&rows, |row| row.times.total_ns.p50 as f64),
    };
    Lines {
        title: format!("{scene}, exact"),
        x_label: "boxes".to_owned(),
        y_label: "whole frame, p50".to_owned(),
        x_unit: Unit::Count,
        y_unit: Unit::Nanoseconds,
        lines: series.into_iter().map(line).collect(),
    }
}

/// Percentiles of one scene over n by one engine, a series a mode. `all` are the modes of the report,
/// which give each its colour. Worlds far from the origin are another question and are left out.
pub(super) fn percentiles(
    scene: &str,
    engine: &str,
    rows: &[AccuracyRow],
    all: &[String],
) -> Ranges {
    let is_its =
        |row: &&AccuracyRow| row.scene == scene && row.engine == engine && row.offset.is_none();
    let range = |(series, mode): (usize, &String)| {
        let of_mode: Vec<&AccuracyRow> =
            rows.iter().filter(is_its).filter(|row| row.mode_text() == *mode).collect();
        let total = |row: &AccuracyRow| row.times.total_ns;
        let points = over_n(&of_mode, |row| [total(row).p50, total(row).p99].map(|ns| ns as f64));
        Range { name: mode.clone(), series, points }
    };
    Ranges {
        title: format!("{scene}, engine {engine}"),
        x_label: "boxes".to_owned(),
        y_label: "whole frame, p50 to p99".to_owned(),
        x_unit: Unit::Count,
        y_unit: Unit::Nanoseconds,
        ends: ["p50".to_owned(), "p99".to_owned()],
        ranges: all.iter().enumerate().map(range).collect(),
    }
}
