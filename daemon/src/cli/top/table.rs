//! The table of clients and their scenes, as text: rows, their order, and columns that fit a width. One file, since a
//! column is a title, a width, a way to order rows and a text of one, which its tests look at together.

use std::cmp::Ordering;

use crate::cli::rates::{ClientRates, Rates, SceneRates, StageMeans};

/// What rows are ordered by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SortKey {
    #[default]
    Cpu,
    Frames,
    Boxes,
    Moved,
    Pairs,
    Time,
    Memory,
    Name,
}

impl SortKey {
    pub const ALL: [Self; 8] = [
        Self::Cpu,
        Self::Frames,
        Self::Boxes,
        Self::Moved,
        Self::Pairs,
        Self::Time,
        Self::Memory,
        Self::Name,
    ];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Cpu => "CPU",
            Self::Frames => "frames/s",
            Self::Boxes => "boxes",
            Self::Moved => "moved",
            Self::Pairs => "pairs",
            Self::Time => "time",
            Self::Memory => "memory",
            Self::Name => "name",
        }
    }

    pub fn next(self) -> Self {
        let at = Self::ALL.iter().position(|key| *key == self).unwrap_or(0);
        Self::ALL[(at + 1) % Self::ALL.len()]
    }

    /// The largest first; names from A on.
    fn order(self, one: &Row, other: &Row) -> Ordering {
        let number = |value: fn(&Row) -> f64| value(other).total_cmp(&value(one));
        match self {
            Self::Cpu => number(|row| row.cpu_share.unwrap_or(0.0)),
            Self::Frames => number(|row| row.rate),
            Self::Boxes => other.boxes.cmp(&one.boxes),
            Self::Moved => number(|row| row.moved_share.unwrap_or(-1.0)),
            Self::Pairs => other.pairs.cmp(&one.pairs),
            Self::Time => other.stages.total_ns.cmp(&one.stages.total_ns),
            Self::Memory => other.memory_bytes.cmp(&one.memory_bytes),
            Self::Name => one.name.cmp(&other.name),
        }
    }
}

/// A client or a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    pub name: String,
    /// Beside the name, and never cut.
    number: String,
    pub is_scene: bool,
    process: Option<u64>,
    boxes: u64,
    moved_share: Option<f64>,
    pairs: u64,
    engine: Option<&'static str>,
    threads: Option<u64>,
    rate: f64,
    stages: StageMeans,
    cpu_share: Option<f64>,
    memory_bytes: u64,
    received: Option<f64>,
    sent: Option<f64>,
    errors: Option<u64>,
    connected_ns: Option<u64>,
}

impl Row {
    fn of_client(client: &ClientRates) -> Self {
        Self {
            name: if client.name.is_empty() { "?".to_owned() } else { client.name.clone() },
            number: format!("#{}", client.session),
            is_scene: false,
            process: Some(client.process).filter(|process| *process > 0),
            boxes: client.boxes,
            moved_share: client.moved_share,
            pairs: client.pairs,
            engine: client.engine,
            threads: Some(client.threads),
            rate: client.frames_per_second,
            stages: client.stages,
            cpu_share: Some(client.cpu_share),
            memory_bytes: client.memory_bytes,
            received: Some(client.received_bytes_per_second),
            sent: Some(client.sent_bytes_per_second),
            errors: Some(client.errors),
            connected_ns: Some(client.connected_ns),
        }
    }

    fn of_scene(scene: &SceneRates, name: &str) -> Self {
        Self {
            name: name.to_owned(),
            number: scene.scene.to_string(),
            is_scene: true,
            boxes: scene.boxes,
            moved_share: scene.moved_share,
            pairs: scene.pairs,
            engine: scene.engine,
            rate: scene.edits_per_second,
            stages: StageMeans {
                ingest_ns: scene.ingest_ns,
                execute_ns: scene.execute_ns,
                ..StageMeans::default()
            },
            memory_bytes: scene.memory_bytes,
            ..Self::default()
        }
    }
}

/// Which rows are shown, and in which order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    pub sort: SortKey,
    pub is_reversed: bool,
    /// Part of a client's name, process or engine; all where it is empty.
    pub filter: String,
}

impl Selection {
    fn has(&self, client: &ClientRates) -> bool {
        let wanted = self.filter.to_lowercase();
        let numbers = [client.process.to_string(), format!("#{}", client.session)];
        let texts = [client.name.to_lowercase(), client.engine.unwrap_or_default().to_owned()];
        texts.iter().chain(&numbers).any(|text| text.contains(&wanted))
    }

    fn sort(&self, rows: &mut [Row]) {
        // Stable: rows that are alike stay where they are from look to look.
        rows.sort_by(|one, other| {
            let order = self.sort.order(one, other);
            if self.is_reversed { order.reverse() } else { order }
        });
    }

    /// Clients in order, each with its scenes behind it, and then the scenes that several clients share.
    pub fn rows(&self, rates: &Rates) -> Vec<Row> {
        let chosen: Vec<&ClientRates> = rates.clients.iter().filter(|c| self.has(c)).collect();
        let mut groups: Vec<(Row, Vec<Row>)> = Vec::new();
        for client in chosen {
            let scenes = client.scenes.iter().map(|scene| Row::of_scene(scene, "scene"));
            let mut scenes: Vec<Row> = scenes.collect();
            self.sort(&mut scenes);
            groups.push((Row::of_client(client), scenes));
        }
        groups.sort_by(|(one, _), (other, _)| {
            let order = self.sort.order(one, other);
            if self.is_reversed { order.reverse() } else { order }
        });
        let mut rows: Vec<Row> = Vec::new();
        for (client, scenes) in groups {
            rows.push(client);
            rows.extend(scenes);
        }
        if self.filter.is_empty() || "shared".contains(&self.filter.to_lowercase()) {
            let shared = rates.shared_scenes.iter().map(|scene| Row::of_scene(scene, "shared"));
            let mut shared: Vec<Row> = shared.collect();
            self.sort(&mut shared);
            rows.extend(shared);
        }
        rows
    }
}

/// A column of the table.
struct Column {
    title: &'static str,
    width: usize,
    /// The narrowest table that has it.
    from: usize,
    cell: fn(&Row) -> String,
    key: Option<SortKey>,
}

/// The narrowest table that is not cut: a terminal of the usual 80 columns.
pub const LEAST_WIDTH: usize = 80;
/// From these widths on there is room for more, and for everything.
const WIDE: usize = 132;
const WIDEST: usize = 150;

impl Column {
    /// A column of every table.
    const fn new(title: &'static str, width: usize, cell: fn(&Row) -> String) -> Self {
        Self { title, width, from: 0, cell, key: None }
    }

    /// Of tables of this width or more.
    const fn at_least(self, from: usize) -> Self {
        Self { from, ..self }
    }

    /// Marked where rows are ordered by this.
    const fn by(self, key: SortKey) -> Self {
        Self { key: Some(key), ..self }
    }
}

/// Columns behind the name, which takes what is left. At 80 columns there are 12 for the name.
const COLUMNS: [Column; 19] = [
    Column::new("PID", 8, |row| optional(row.process)).at_least(100),
    Column::new("BOXES", 5, |row| count(row.boxes)).by(SortKey::Boxes),
    Column::new("MOVE", 4, |row| percent(row.moved_share)).by(SortKey::Moved),
    Column::new("PAIRS", 5, |row| count(row.pairs)).by(SortKey::Pairs),
    Column::new(LEFT, 9, |row| row.engine.unwrap_or("-").to_owned()),
    Column::new("TH", 3, |row| optional(row.threads)).at_least(WIDE),
    Column::new("FRM/S", 5, |row| rate(row.rate)).by(SortKey::Frames),
    Column::new("WAIT", 4, |row| micros(row.stages.wait_ns)),
    Column::new("INGE", 4, |row| micros(row.stages.ingest_ns)),
    Column::new("PLAN", 4, |row| micros(row.stages.plan_ns)),
    Column::new("EXEC", 4, |row| micros(row.stages.execute_ns)),
    Column::new("PUBL", 4, |row| micros(row.stages.publish_ns)),
    Column::new("TOTAL", 5, |row| micros(row.stages.total_ns)).by(SortKey::Time).at_least(WIDE),
    Column::new("CPU%", 4, |row| row.cpu_share.map_or_else(dash, cpu_percent)).by(SortKey::Cpu),
    Column::new("MEM", 4, |row| bytes(row.memory_bytes)).by(SortKey::Memory),
    Column::new("IN/S", 5, |row| row.received.map_or_else(dash, |b| bytes(b as u64)))
        .at_least(WIDE),
    Column::new("OUT/S", 5, |row| row.sent.map_or_else(dash, |b| bytes(b as u64))).at_least(WIDE),
    Column::new("ERR", 5, |row| row.errors.map_or_else(dash, count)).at_least(WIDE),
    Column::new("UP", 9, |row| row.connected_ns.map_or_else(dash, long_time)).at_least(WIDEST),
];

/// The column of text, which begins at the left.
const LEFT: &str = "ENGINE";

fn columns(width: usize) -> impl Iterator<Item = &'static Column> {
    COLUMNS.iter().filter(move |column| column.from <= width)
}

/// Columns of a name that is longer than this would stand too far from its figures.
const WIDEST_NAME: usize = 32;

fn name_width(width: usize) -> usize {
    let others: usize = columns(width).map(|column| column.width + 1).sum();
    width.saturating_sub(others).clamp(8, WIDEST_NAME)
}

/// The head of the table for a width. The column that rows are ordered by is marked.
pub fn head(width: usize, selection: &Selection) -> String {
    let name = if selection.sort == SortKey::Name { "*CLIENT" } else { "CLIENT" };
    let mut line = pad_left(name, name_width(width));
    for column in columns(width) {
        let title = if column.key == Some(selection.sort) {
            // No column is wider by its mark: it takes the place of the blank before it.
            format!("*{:>width$}", column.title, width = column.width)
        } else {
            format!(" {}", aligned(column, column.title))
        };
        line.push_str(&title);
    }
    line
}

/// A row of the table.
pub fn line(row: &Row, width: usize) -> String {
    let indent = usize::from(row.is_scene);
    let room = name_width(width) - indent;
    let name_room = room.saturating_sub(row.number.chars().count() + 1);
    let name: String = row.name.chars().take(name_room).collect();
    let label = format!("{:indent$}{name} {}", "", row.number);
    let mut line = pad_left(&label, name_width(width));
    for column in columns(width) {
        line.push(' ');
        line.push_str(&aligned(column, &(column.cell)(row)));
    }
    line
}

fn aligned(column: &Column, text: &str) -> String {
    if column.title == LEFT {
        pad_left(text, column.width)
    } else {
        let text: String = text.chars().take(column.width).collect();
        format!("{text:>width$}", width = column.width)
    }
}

/// Text at the left of so many columns, cut where it is longer.
fn pad_left(text: &str, width: usize) -> String {
    let text: String = text.chars().take(width).collect();
    format!("{text:<width$}")
}

fn dash() -> String {
    "-".to_owned()
}

fn optional(number: Option<u64>) -> String {
    number.map_or_else(dash, |number| number.to_string())
}

/// A number in five columns at most.
pub fn count(n: u64) -> String {
    scaled(n as f64, 10_000.0, 1000.0, ["", "k", "M", "G", "T", "P"])
}

/// Bytes in four columns at most.
pub fn bytes(n: u64) -> String {
    let units = ["", "K", "M", "G", "T", "P"];
    let (mut value, mut unit) = (n as f64, 0);
    while value >= 1000.0 && unit + 1 < units.len() {
        value /= 1024.0;
        unit += 1;
    }
    let digits = usize::from(unit > 0 && value < 9.95);
    format!("{value:.digits$}{}", units[unit])
}

/// A rate in five columns at most.
pub fn rate(a_second: f64) -> String {
    match a_second {
        r if r <= 0.0 => "0".to_owned(),
        r if r < 9.95 => format!("{r:.1}"),
        r => count(r.round() as u64),
    }
}

fn scaled(value: f64, least: f64, step: f64, units: [&str; 6]) -> String {
    if value < least {
        return format!("{value:.0}");
    }
    let (mut value, mut unit) = (value, 0);
    while value >= 999.5 && unit + 1 < units.len() {
        value /= step;
        unit += 1;
    }
    let digits = match value {
        v if v < 9.995 => 2,
        v if v < 99.95 => 1,
        _ => 0,
    };
    format!("{value:.digits$}{}", units[unit])
}

/// A time in µs, or with its unit where that is longer than four columns.
pub fn micros(ns: Option<u64>) -> String {
    let Some(ns) = ns else { return dash() };
    let us = ns as f64 / 1e3;
    match us {
        us if us < 9.95 => format!("{us:.1}"),
        us if us < 9_999.5 => format!("{us:.0}"),
        us if us < 99_500.0 => format!("{:.0}ms", us / 1e3),
        us if us < 9.95e6 => format!("{:.1}s", us / 1e6),
        us => format!("{:.0}s", (us / 1e6).min(999.0)),
    }
}

/// A time of seconds to years.
pub fn long_time(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    let (minutes, hours) = (seconds / 60, seconds / 3600);
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{minutes} m {:02} s", seconds % 60),
        3600..86_400 => format!("{hours} h {:02} m", minutes % 60),
        _ => format!("{} d {:02} h", hours / 24, hours % 24),
    }
}

/// A share in four columns; 100 % is all.
pub fn percent(share: Option<f64>) -> String {
    match share.map(|share| share * 100.0) {
        None => dash(),
        Some(p) if p <= 0.0 => "0%".to_owned(),
        Some(p) if p < 0.95 => format!("{p:.1}").trim_start_matches('0').to_owned() + "%",
        Some(p) => format!("{p:.0}%"),
    }
}

/// A share of one core in four columns: 100 is one core all the time.
pub fn cpu_percent(share: f64) -> String {
    match share * 100.0 {
        p if p <= 0.0 => "0".to_owned(),
        p if p < 9.95 => format!("{p:.1}"),
        p => format!("{:.0}", p.min(9999.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(session: u64, name: &str, rate: f64, cpu: f64) -> ClientRates {
        ClientRates {
            session,
            name: name.to_owned(),
            process: session.wrapping_add(4000),
            frames_per_second: rate,
            cpu_share: cpu,
            engine: Some("cpu-brute"),
            ..ClientRates::default()
        }
    }

    fn rates() -> Rates {
        let mut with_scenes = client(2, "game", 60.0, 0.2);
        let scene = |scene, boxes| SceneRates { scene, boxes, ..SceneRates::default() };
        with_scenes.scenes = vec![scene(1, 10), scene(2, 900)];
        let clients = vec![client(1, "arm", 10.0, 0.01), with_scenes, client(3, "zoo", 240.0, 0.1)];
        Rates { clients, shared_scenes: vec![scene(5, 7)], ..Rates::default() }
    }

    fn labels(selection: &Selection) -> String {
        let rows = selection.rows(&rates());
        rows.iter().map(|row| format!("{} {}", row.name, row.number)).collect::<Vec<_>>().join(", ")
    }

    #[test]
    fn clients_are_sorted_and_their_scenes_stand_behind_them() {
        let by = |sort| Selection { sort, ..Selection::default() };
        assert_eq!(
            labels(&by(SortKey::Cpu)),
            "game #2, scene 1, scene 2, zoo #3, arm #1, shared 5"
        );
        assert_eq!(
            labels(&by(SortKey::Boxes)),
            "arm #1, game #2, scene 2, scene 1, zoo #3, shared 5"
        );
        assert!(labels(&by(SortKey::Frames)).starts_with("zoo #3, game #2"));
        assert!(labels(&by(SortKey::Name)).starts_with("arm #1, game #2"));
        let reversed = Selection { is_reversed: true, ..by(SortKey::Frames) };
        assert!(labels(&reversed).starts_with("arm #1, game #2"));
        let keys: Vec<_> =
            std::iter::successors(Some(SortKey::Cpu), |key| Some(key.next())).take(9).collect();
        assert_eq!(keys[..8], SortKey::ALL);
        assert_eq!(keys[8], SortKey::Cpu);
    }

    #[test]
    fn a_filter_leaves_those_whose_name_process_or_engine_has_it() {
        let having =
            |filter: &str| labels(&Selection { filter: filter.to_owned(), ..Selection::default() });
        assert_eq!(having("GA"), "game #2, scene 1, scene 2");
        assert_eq!(having("4003"), "zoo #3");
        assert_eq!(having("#1"), "arm #1");
        assert_eq!(having("gpu"), "");
        assert_eq!(having("brute").matches('#').count(), 3);
        assert_eq!(having("shared"), "shared 5");
    }

    #[test]
    fn lines_have_the_width_of_the_table() {
        let mut wild = client(u64::MAX, "a process with a long name", f64::MAX, 1e9);
        wild.boxes = u64::MAX;
        wild.memory_bytes = u64::MAX;
        wild.moved_share = Some(1.0);
        wild.stages.wait_ns = Some(u64::MAX);
        let rows = Selection::default().rows(&Rates { clients: vec![wild], ..rates() });
        for width in [80, 100, 132, 150, 160] {
            let head = head(width, &Selection::default());
            let widest = head.chars().count();
            assert!(widest <= width && (width > 100 || widest == width), "{width}: {widest}");
            for row in &rows {
                assert_eq!(line(row, width).chars().count(), widest, "{width}: {row:?}");
            }
        }
    }

    #[test]
    fn figures_fit_their_columns() {
        let counts = [0, 9_999, 10_000, 12_345, 999_499, 999_500, 1_234_567, u64::MAX];
        let texts = counts.map(count);
        assert_eq!(texts[..7], ["0", "9999", "10.0k", "12.3k", "999k", "1.00M", "1.23M"]);
        assert!(texts.iter().all(|text| text.len() <= 6));
        let sizes = [0, 999, 1000, 1024, 10 << 10, 1 << 20, 999 << 20, 1 << 30].map(bytes);
        assert_eq!(sizes, ["0", "999", "1.0K", "1.0K", "10K", "1.0M", "999M", "1.0G"]);
        let times = [None, Some(0), Some(1_234), Some(56_789), Some(9_999_000), Some(45_000_000)];
        assert_eq!(times.map(micros), ["-", "0.0", "1.2", "57", "9999", "45ms"]);
        assert_eq!(
            [99_600_000, 2_500_000_000, 60_000_000_000].map(|ns| micros(Some(ns))),
            ["0.1s", "2.5s", "60s"]
        );
        assert_eq!(
            [None, Some(0.0), Some(0.001), Some(0.01), Some(0.256), Some(1.0)].map(percent),
            ["-", "0%", ".1%", "1%", "26%", "100%"]
        );
        let times = [0, 59, 60, 3_599, 3_602, 90_000].map(|s| long_time(s * 1_000_000_000));
        assert_eq!(times, ["0 s", "59 s", "1 m 00 s", "59 m 59 s", "1 h 00 m", "1 d 01 h"]);
        assert_eq!([0.0, 0.004, 0.5, 12.0].map(cpu_percent), ["0", "0.4", "50", "1200"]);
        assert_eq!([0.0, 0.5, 59.96, 12_345.0].map(rate), ["0", "0.5", "60", "12.3k"]);
    }
}
