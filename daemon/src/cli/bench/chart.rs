//! Plots of a report's rows.

use std::collections::BTreeMap;

use super::report::{LatencyReport, LatencyRow, LoadRow};
use crate::plot::{Line, Lines, Plot, Unit, standalone};

/// What a plot has on its x axis.
#[derive(Clone, Copy)]
enum Across {
    /// Frames a second of each client. A closed loop stands at what it reached.
    Pace,
    /// Clients at a time.
    Clients,
    /// Boxes of a frame.
    Boxes,
}

/// A row's number on the y axis.
type Height = fn(&LatencyRow) -> f64;

/// The plots that a report's rows have points for, as the text of an SVG file.
pub fn svg(report: &LatencyReport) -> String {
    let machine = &report.machine;
    let lines = [
        format!("{}, {} cores; {}", machine.cpu, machine.cores, machine.kernel),
        format!("commit {}; {}", machine.commit, machine.command),
    ];
    let plots: Vec<Plot> = [Across::Pace, Across::Clients, Across::Boxes]
        .into_iter()
        .filter(|across| across.has_several(&report.rows))
        .flat_map(|across| plots(&report.rows, across))
        .collect();
    standalone("Latency of frames", &lines, &plots)
}

fn plots(rows: &[LatencyRow], across: Across) -> Vec<Plot> {
    let p50: Height = |row| row.round_trip_ns.p50 as f64;
    let p99: Height = |row| row.round_trip_ns.p99 as f64;
    let due: Height = |row| row.load.as_ref().map_or(0.0, |load| load.from_due_ns.p99 as f64);
    let per_second: Height = |row| row.load.as_ref().map_or(0.0, |load| load.frames_per_second);
    let percent: Height = |row| row.daemon_cpu_percent.unwrap_or_default();
    let plot = |title: &str, y_label: &str, y_unit, kinds: &[(&str, Height)]| {
        let lines = lines(rows, across, kinds);
        (!lines.is_empty()).then(|| {
            let lines = Lines {
                title: format!("{title} by {}", across.label()),
                x_label: across.label().to_owned(),
                y_label: y_label.to_owned(),
                x_unit: Unit::Count,
                y_unit,
                lines,
            };
            lines.draw()
        })
    };
    let trip = plot("Round trip", "round trip", Unit::Nanoseconds, &[("p50", p50), ("p99", p99)]);
    let due = plot("From due to last pair", "from due", Unit::Nanoseconds, &[("p99", due)]);
    let all = plot("Frames a second in all", "frames a second", Unit::Count, &[("", per_second)]);
    let used = plot("The daemon's share of a core", "percent", Unit::Ratio, &[("", percent)]);
    let drawn = match across {
        Across::Pace => [trip, due, used],
        Across::Clients => [trip, all, used],
        Across::Boxes => [trip, None, used],
    };
    drawn.into_iter().flatten().collect()
}

/// A line for every kind of height and every setting that differs in more than x, with points where
/// there is a height above zero.
fn lines(rows: &[LatencyRow], across: Across, kinds: &[(&str, Height)]) -> Vec<Line> {
    let mut lines: BTreeMap<(String, usize), Vec<(f64, f64)>> = BTreeMap::new();
    for row in rows {
        for (kind, (name, height)) in kinds.iter().enumerate() {
            let y = height(row);
            if y > 0.0 {
                let name = format!("{} {name}", across.setting(row)).trim_end().to_owned();
                lines.entry((name, kind)).or_default().push((across.x(row), y));
            }
        }
    }
    let line = |((name, _), mut points): (_, Vec<(f64, f64)>)| {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Line { name, points }
    };
    lines.into_iter().map(line).collect()
}

impl Across {
    const fn label(self) -> &'static str {
        match self {
            Self::Pace => "frames a second of a client",
            Self::Clients => "clients",
            Self::Boxes => "boxes",
        }
    }

    fn x(self, row: &LatencyRow) -> f64 {
        let load = row.load.as_ref();
        match self {
            Self::Pace => load.map_or(0.0, |l| l.frames_per_second / f64::from(l.clients.max(1))),
            Self::Clients => load.map_or(1.0, |load| f64::from(load.clients_in_all)),
            Self::Boxes => f64::from(row.n),
        }
    }

    /// Whether rows differ on this axis.
    fn has_several(self, rows: &[LatencyRow]) -> bool {
        let key = |row: &LatencyRow| {
            let load = row.load.as_ref();
            match self {
                Self::Pace => load.map(|load| load.rate.clone()).unwrap_or_default(),
                Self::Clients => load.map_or(1, |load| load.clients_in_all).to_string(),
                Self::Boxes => row.n.to_string(),
            }
        };
        // A closed loop alone has no pace.
        let is_alone = matches!(self, Self::Pace);
        let has_pace = rows.iter().any(|row| row.load.as_ref().is_some_and(LoadRow::is_paced));
        let mut keys = rows.iter().map(key);
        let first = keys.next();
        (is_alone && has_pace) || keys.any(|key| Some(key) != first)
    }

    /// What a row is beside its x, as far as readers need it.
    fn setting(self, row: &LatencyRow) -> String {
        let mut words = Vec::new();
        if !matches!(self, Self::Boxes) {
            words.push(format!("{} boxes", row.n));
        }
        if let Some(load) = &row.load {
            if !matches!(self, Self::Clients) && load.clients_in_all > 1 {
                words.push(format!("{} of {} clients", load.clients, load.clients_in_all));
            }
            if !matches!(self, Self::Pace) {
                words.push(if load.is_paced() {
                    format!("{} Hz", load.rate)
                } else {
                    load.rate.clone()
                });
            }
        }
        if row.precision != "exact" {
            words.push(row.precision.clone());
        }
        words.push(row.wait.clone());
        words.join(", ")
    }
}
