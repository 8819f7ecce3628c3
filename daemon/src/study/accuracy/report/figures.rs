//! From rows to plots.

use std::collections::{BTreeMap, BTreeSet};

use crate::study::accuracy::rows::AccuracyRow;
use crate::study::plot::{Bar, Bars, Group, Line, Lines, Point, Points, Unit, pareto_front};

use super::papers;

/// Rows of one scene and size.
pub(super) struct Setting<'a> {
    pub(super) scene: &'a str,
    pub(super) n: u32,
    pub(super) rows: Vec<&'a AccuracyRow>,
}

impl Setting<'_> {
    pub(super) fn title(&self) -> String {
        format!("{}, {} boxes", self.scene, Unit::Count.text(f64::from(self.n)))
    }
}

/// Rows by scene and size, in the order in which the scenes were measured, sizes rising.
pub(super) fn settings(rows: &[AccuracyRow]) -> Vec<Setting<'_>> {
    let mut scenes: Vec<&str> = Vec::new();
    let mut by_setting: BTreeMap<(usize, u32), Vec<&AccuracyRow>> = BTreeMap::new();
    for row in rows {
        let scene = scenes.iter().position(|s| *s == row.scene).unwrap_or_else(|| {
            scenes.push(&row.scene);
            scenes.len() - 1
        });
        by_setting.entry((scene, row.n)).or_default().push(row);
    }
    by_setting
        .into_iter()
        .map(|((scene, n), rows)| Setting { scene: scenes[scene], n, rows })
        .collect()
}

/// A row's engine and where it ran.
pub(super) fn engine_name(row: &AccuracyRow) -> String {
    let answered = if row.engine == row.served_by_engine {
        row.engine.clone()
    } else {
        format!("{} ({})", row.engine, row.served_by_engine)
    };
    format!("{answered}, {}", row.backend)
}

/// Modes in the order in which they were measured.
pub(super) fn modes<'a>(rows: impl IntoIterator<Item = &'a AccuracyRow>) -> Vec<String> {
    let mut seen = BTreeSet::new();
    rows.into_iter().map(AccuracyRow::mode_text).filter(|mode| seen.insert(mode.clone())).collect()
}

/// Extra pairs and time of a row that may stand in a comparison: it missed nothing.
fn place(row: &AccuracyRow) -> Option<(f64, f64)> {
    (row.missed == 0).then_some((row.extra_ratio?, row.times.total_ns.p50 as f64))
}

/// How a mode did over all settings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModeVerdict {
    /// The mode.
    pub mode: String,
    /// Settings (scene and size) in which it was measured.
    pub settings: usize,
    /// Those of them in which it is on the Pareto front of time and extra pairs.
    pub on_front: usize,
}

/// Where each mode is on the Pareto front. Rows with missed pairs never are.
pub fn front_verdicts(rows: &[AccuracyRow]) -> Vec<ModeVerdict> {
    let settings = settings(rows);
    let on_front = |setting: &Setting<'_>, mode: &str| {
        let placed: Vec<_> =
            setting.rows.iter().filter_map(|row| Some((row, place(row)?))).collect();
        let places: Vec<_> = placed.iter().map(|(_, place)| *place).collect();
        let front = pareto_front(&places);
        placed.iter().zip(front).any(|((row, _), wins)| wins && row.mode_text() == mode)
    };
    let has =
        |setting: &&Setting<'_>, mode: &str| setting.rows.iter().any(|r| r.mode_text() == mode);
    modes(rows)
        .into_iter()
        .map(|mode| ModeVerdict {
            settings: settings.iter().filter(|s| has(s, &mode)).count(),
            on_front: settings.iter().filter(|s| on_front(s, &mode)).count(),
            mode,
        })
        .collect()
}

/// Speed against error in one setting.
pub(super) fn speed_against_error(setting: &Setting<'_>) -> Points {
    let group = |mode: String| {
        let of_mode = setting.rows.iter().filter(|row| row.mode_text() == mode);
        let points = of_mode
            .filter_map(|row| {
                let (x, y) = place(row)?;
                Some(Point { x, y, label: format!("{mode}, {}", engine_name(row)) })
            })
            .collect();
        Group { name: mode, points }
    };
    Points {
        title: setting.title(),
        x_label: "extra pairs a true pair".to_owned(),
        y_label: "whole frame, p50".to_owned(),
        x_unit: Unit::Ratio,
        y_unit: Unit::Nanoseconds,
        groups: modes(setting.rows.iter().copied()).into_iter().map(group).collect(),
    }
}

/// Medians of the stages in one setting, a bar for every row.
pub(super) fn stages(setting: &Setting<'_>) -> Bars {
    let parts = ["fill", "ingest", "plan", "execute", "publish", "the way", "decode"];
    let bars = setting
        .rows
        .iter()
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

/// One series: name, then (boxes, ns) by rising n.
type Series = BTreeMap<String, Vec<(f64, f64)>>;

fn lines_of(title: String, y_label: &str, series: Series, more: Vec<Line>) -> Lines {
    let ours = series.into_iter().map(|(name, mut points)| {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Line { name, points }
    });
    Lines {
        title,
        x_label: "boxes".to_owned(),
        y_label: y_label.to_owned(),
        x_unit: Unit::Count,
        y_unit: Unit::Nanoseconds,
        lines: ours.chain(more).collect(),
    }
}

fn paper_lines() -> Vec<Line> {
    papers::LINES
        .iter()
        .map(|line| Line { name: line.name.to_owned(), points: line.points.to_vec() })
        .collect()
}

/// Exact frames of one scene over n, a line an engine, with the papers' lines.
pub(super) fn scaling(scene: &str, rows: &[AccuracyRow]) -> Lines {
    let mut series = Series::new();
    for row in rows.iter().filter(|row| row.scene == scene && row.mode == "exact") {
        let name = format!("{}, {}", row.engine, row.backend);
        let point = (f64::from(row.n), row.times.total_ns.p50 as f64);
        series.entry(name).or_default().push(point);
    }
    lines_of(format!("{scene}, exact"), "whole frame, p50", series, paper_lines())
}

/// Percentiles of one scene over n, the engine that the plan chose: two lines a mode.
pub(super) fn percentiles(scene: &str, rows: &[AccuracyRow]) -> Lines {
    let mut series = Series::new();
    for row in rows.iter().filter(|row| row.scene == scene && row.engine == "auto") {
        for (name, ns) in [("p50", row.times.total_ns.p50), ("p99", row.times.total_ns.p99)] {
            let point = (f64::from(row.n), ns as f64);
            let key = format!("{} {name}, {}", row.mode_text(), row.backend);
            series.entry(key).or_default().push(point);
        }
    }
    lines_of(format!("{scene}, engine auto"), "whole frame", series, Vec::new())
}
