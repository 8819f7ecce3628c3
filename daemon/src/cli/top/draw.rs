//! The screen, drawn from two looks at the counters and the view: nothing else.

use std::fmt::Write;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::table::{LEAST_WIDTH, Row, bytes, count, head, line, long_time, rate};
use super::view::View;
use crate::cli::output::time_text;
use crate::cli::rates::{Look, Rates, TotalRates};

/// Where the looks are from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    pub instance: String,
    /// `alive`, or what is the matter.
    pub state: String,
    pub is_alive: bool,
    pub interval_ms: u64,
    pub cores: usize,
}

/// Styles of the screen: with colours, or with bold and reversed text alone.
#[derive(Clone, Copy, Debug)]
pub struct Styles {
    has_colours: bool,
}

impl Styles {
    pub const fn new(has_colours: bool) -> Self {
        Self { has_colours }
    }

    fn colour(self, colour: Color) -> Style {
        if self.has_colours { Style::new().fg(colour) } else { Style::new() }
    }

    fn label(self) -> Style {
        self.colour(Color::Cyan)
    }

    fn alarm(self) -> Style {
        self.colour(Color::Red).add_modifier(Modifier::BOLD)
    }

    fn head() -> Style {
        Style::new().add_modifier(Modifier::REVERSED)
    }

    fn scene(self) -> Style {
        if self.has_colours {
            Style::new().fg(Color::DarkGray)
        } else {
            Style::new().add_modifier(Modifier::DIM)
        }
    }
}

const HELP: [&str; 20] = [
    "CLIENT  name of the process, number of its session; its scenes stand below it",
    "BOXES   boxes or spheres of the last frame, or in the scene",
    "MOVE    share of a scene's boxes that an edit sets",
    "PAIRS   pairs of the last frame, or in the scene",
    "ENGINE  which engine found them",
    "FRM/S   frames, edits, queries and casts a second; of a scene its edits",
    "WAIT    time from receipt until its turn, mean of a frame, µs",
    "INGE    time to read boxes and edits",
    "PLAN    time to choose an engine",
    "EXEC    time to find pairs",
    "PUBL    time to write the answer",
    "CPU%    time of threads that served it; 100 is one core",
    "MEM     memory that it takes of the daemon's budget",
    "",
    "s r     sort by the next column; in reverse",
    "/       filter by a part of name, process, session or engine; Esc drops it",
    "p       pause",
    "↑ ↓     scroll, as do page keys, Home and End",
    "q       quit",
    "?       leave this help",
];

/// Draws what was done between two looks; nothing, where there is no earlier one. Returns how far the table scrolls.
pub fn draw(
    frame: &mut Frame<'_>,
    (now, before): (&Look, Option<&Look>),
    source: &Source,
    view: &View,
    styles: Styles,
) -> usize {
    let rates = Rates::between(before.unwrap_or(now), now);
    let rows = view.selection.rows(&rates);
    let area = frame.area();
    // The help is as long as the smallest usual screen.
    let header = if view.has_help {
        Vec::new()
    } else {
        header(&rates, source, view, styles, area.width.into())
    };
    let [top, table, bottom] = Layout::vertical([
        Constraint::Length(header.len() as u16),
        Constraint::Min(0),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(header), top);
    let room = usize::from(table.height).saturating_sub(1);
    let most_scroll = rows.len().saturating_sub(room.max(1));
    if view.has_help {
        frame.render_widget(Paragraph::new(HELP.map(Line::from).to_vec()), table);
    } else {
        draw_table(frame, table, &rows, (view, view.scroll.min(most_scroll)), styles);
    }
    frame.render_widget(Paragraph::new(footer(&rows, view, table.height.into(), styles)), bottom);
    most_scroll
}

fn header(
    rates: &Rates,
    source: &Source,
    view: &View,
    styles: Styles,
    width: usize,
) -> Vec<Line<'static>> {
    let totals = &rates.totals;
    let Source { instance, state, is_alive, interval_ms, cores } = source;
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let state_style = if *is_alive { styles.colour(Color::Green) } else { styles.alarm() };
    let paused = if view.is_paused { "  paused" } else { "" };
    let label = |text: &str| Span::styled(format!("{text:<8}"), styles.label());
    let first = Line::from(vec![
        Span::styled(format!("{instance}: "), bold),
        Span::styled(state.clone(), state_style),
        Span::raw(format!(
            "  up {}  every {}  times in µs",
            long_time(totals.uptime_ns),
            time_text(interval_ms * 1_000_000)
        )),
        Span::styled(paused, styles.alarm()),
    ]);
    let mut second = vec![label("served"), Span::raw(served_text(totals))];
    if totals.errors > 0 {
        second.push(Span::styled(format!("  {} errors", count(totals.errors)), styles.alarm()));
    }
    let scenes = rates.clients.iter().map(|client| client.scenes.len()).sum::<usize>();
    let scenes = scenes + rates.shared_scenes.len();
    let third = vec![
        label("clients"),
        Span::raw(format!(
            "{}, {scenes} scenes  queue {} waiting, {} served  in {}/s out {}/s",
            rates.clients.len(),
            totals.waiting,
            totals.serving,
            bytes(totals.received_bytes_per_second as u64),
            bytes(totals.sent_bytes_per_second as u64),
        )),
    ];
    let bar = if width >= 120 { 40 } else { 10 };
    let memory_share = totals.memory_bytes as f64 / (totals.memory_limit_bytes.max(1)) as f64;
    let fourth = vec![
        label("CPU"),
        Span::raw(format!(
            "{} {:>4.0} % of {cores} cores  ",
            bar_text(totals.cpu_share / (*cores).max(1) as f64, bar),
            totals.cpu_share * 100.0
        )),
        Span::styled("memory ", styles.label()),
        Span::raw(format!(
            "{} {} of {}",
            bar_text(memory_share, bar),
            bytes(totals.memory_bytes),
            bytes(totals.memory_limit_bytes)
        )),
    ];
    let mut lines = vec![first, second.into(), third.into(), fourth.into()];
    if !totals.gpus.is_empty() {
        let share = totals.gpu_share / totals.gpus.len() as f64;
        lines.push(Line::from(vec![
            label("GPU"),
            Span::raw(format!(
                "{} {:>4.0} % busy  {}",
                bar_text(share, bar),
                share * 100.0,
                totals.gpus.join(", ")
            )),
        ]));
    }
    lines.push(Line::default());
    lines
}

fn served_text(totals: &TotalRates) -> String {
    let TotalRates { frames_per_second, boxes_per_second, pairs_per_second, frames, .. } = totals;
    format!(
        "{} frames/s  {} boxes/s  {} pairs/s  {} in all",
        rate(*frames_per_second),
        rate(*boxes_per_second),
        rate(*pairs_per_second),
        count(*frames)
    )
}

/// A bar of ASCII, which every terminal has.
fn bar_text(share: f64, width: usize) -> String {
    let filled = (share.clamp(0.0, 1.0) * width as f64).round() as usize;
    format!("[{:<width$}]", "|".repeat(filled.min(width)))
}

fn draw_table(
    frame: &mut Frame<'_>,
    area: Rect,
    rows: &[Row],
    (view, scroll): (&View, usize),
    styles: Styles,
) {
    let width = usize::from(area.width).max(LEAST_WIDTH);
    let room = usize::from(area.height).saturating_sub(1);
    let title = head(width, &view.selection);
    let mut lines =
        vec![Line::styled(format!("{title:<w$}", w = usize::from(area.width)), Styles::head())];
    lines.extend(rows.iter().skip(scroll).take(room).map(|row| {
        let style = if row.is_scene { styles.scene() } else { Style::new() };
        Line::styled(line(row, width), style)
    }));
    if rows.is_empty() {
        let none = match view.selection.filter.as_str() {
            "" => "no client is connected".to_owned(),
            filter => format!("no client has '{filter}' in name, process, session or engine"),
        };
        lines.push(Line::from(none));
    }
    frame.render_widget(Paragraph::new(lines), area);
}

fn footer(rows: &[Row], view: &View, height: usize, styles: Styles) -> Line<'static> {
    let selection = &view.selection;
    if view.is_typing {
        return Line::from(vec![
            Span::styled("filter: ", styles.label()),
            Span::raw(format!("{}_", selection.filter)),
            Span::raw("  Enter keeps it, Esc drops it"),
        ]);
    }
    let order = if selection.is_reversed { ", reversed" } else { "" };
    let mut text = format!("q quit  s sort: {}{order}  r reverse", selection.sort.as_str());
    // Writing to a string cannot fail.
    match selection.filter.as_str() {
        "" => text.push_str("  / filter"),
        filter => _ = write!(text, "  / filter: {filter}"),
    }
    text.push_str("  p pause  ? help");
    let room = height.saturating_sub(1);
    if rows.len() > room {
        let _ = write!(text, "  {} rows", rows.len());
    }
    Line::from(text)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::time::Duration;

    use pairmask_core::EngineName;
    use pairmask_transport::{ClientCounts, CounterSample, SceneCounts, TotalCounts};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;
    use crate::cli::top::table::SortKey;

    fn name(text: &str) -> [u64; 2] {
        let mut bytes = [0; 16];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        [0, 8].map(|at| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()))
    }

    fn client(session: u64, process: &str, frames: u64) -> ClientCounts {
        ClientCounts {
            session,
            process: 4000 + session,
            name: name(process),
            frames,
            last_boxes: 10_000,
            last_pairs: 12_345,
            engine: EngineName::CpuGrid as u64,
            threads: 2,
            wait_ns: 3_000 * frames,
            ingest_ns: 20_000 * frames,
            plan_ns: 500 * frames,
            execute_ns: 150_000 * frames,
            publish_ns: 30_000 * frames,
            total_ns: 200_000 * frames,
            used_ns: 400_000 * frames,
            memory_bytes: 3 << 20,
            ..ClientCounts::default()
        }
    }

    /// A second look at a daemon of 300 frames a second, and the first.
    fn looks(clients: u64) -> (Look, Look) {
        let look = |second: u64| {
            let frames = 300 * second;
            let mut all: Vec<_> = (3..=clients).map(|n| client(n, "crowd", n * second)).collect();
            all.extend([client(1, "falling_boxes", 240 * second), client(2, "game", 60 * second)]);
            all.truncate(clients as usize);
            let scene = SceneCounts {
                number: 1,
                session: 2,
                scene: 4,
                edits: 60 * second,
                moved: 60 * second,
                kept: 6_000 * second,
                boxes: 100_000,
                ..SceneCounts::default()
            };
            let totals = TotalCounts {
                uptime_ns: 3_600_000_000_000 + second * 1_000_000_000,
                frames,
                boxes: 10_000 * frames,
                pairs: 12_345 * frames,
                waiting: 2,
                serving: 1,
                cpu_ns: 500_000_000 * second,
                gpu_ns: 250_000_000 * second,
                memory_bytes: 4 << 30,
                memory_limit_bytes: 16 << 30,
                ..TotalCounts::default()
            };
            let sample = CounterSample {
                worker: 1,
                totals,
                gpus: vec!["NVIDIA H200".to_owned()],
                clients: all,
                scenes: vec![scene],
            };
            Look { at: Duration::from_secs(second), sample, cpu: None }
        };
        (look(2), look(1))
    }

    fn source() -> Source {
        Source {
            instance: "world".to_owned(),
            state: "alive, process 77".to_owned(),
            is_alive: true,
            interval_ms: 1000,
            cores: 2,
        }
    }

    fn screen(
        width: u16,
        height: u16,
        clients: u64,
        view: &View,
        has_colours: bool,
    ) -> TestBackend {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        let (now, before) = looks(clients);
        let styles = Styles::new(has_colours);
        terminal
            .draw(|frame| _ = draw(frame, (&now, Some(&before)), &source(), view, styles))
            .unwrap();
        terminal.backend().clone()
    }

    fn lines(screen: &TestBackend) -> Vec<String> {
        let buffer = screen.buffer();
        let cells: Vec<&str> = buffer.content().iter().map(ratatui::buffer::Cell::symbol).collect();
        cells.chunks(usize::from(buffer.area.width)).map(<[&str]>::concat).collect()
    }

    #[test]
    fn a_screen_of_80_columns_has_all_figures() {
        let lines = lines(&screen(80, 24, 2, &View::default(), false));
        let expected = [
            "world: alive, process 77  up 1 h 00 m  every 1.0 s  times in µs",
            "served  300 frames/s  3.00M boxes/s  3.70M pairs/s  600 in all",
            "clients 2, 1 scenes  queue 2 waiting, 1 served  in 0/s out 0/s",
            "CPU     [|||       ]   50 % of 2 cores  memory [|||       ] 4.0G of 16G",
            "GPU     [|||       ]   25 % busy  NVIDIA H200",
            "",
            "CLIENT       BOXES MOVE PAIRS ENGINE    FRM/S WAIT INGE PLAN EXEC PUBL*CPU%  MEM",
            "falling_b #1 10.0k    - 12.3k cpu-grid    240  3.0   20  0.5  150   30  9.6 3.0M",
            "game #2      10.0k    - 12.3k cpu-grid     60  3.0   20  0.5  150   30  2.4 3.0M",
            " scene 4      100k   1%     0 -            60    -  0.0    -  0.0    -    -    0",
        ];
        for (line, expected) in lines.iter().zip(expected) {
            assert_eq!(line.trim_end(), expected);
        }
        let help = "q quit  s sort: CPU  r reverse  / filter  p pause  ? help";
        assert_eq!(lines[23].trim_end(), help);
    }

    #[test]
    fn a_large_screen_has_more_columns() {
        let lines = lines(&screen(160, 50, 2, &View::default(), true));
        let head = lines.iter().find(|line| line.starts_with("CLIENT")).unwrap();
        for title in ["PID", "TH", "TOTAL", "IN/S", "OUT/S", "ERR"] {
            assert!(head.contains(title), "{title}: {head}");
        }
        assert!(
            lines.iter().any(|line| line.contains("falling_boxes #1") && line.contains("4001"))
        );
    }

    #[test]
    fn no_screen_is_too_small_and_none_has_colours_where_they_are_not_wanted() {
        for (width, height) in [(1, 1), (20, 3), (79, 7), (80, 24), (500, 200)] {
            for clients in [0, 1, 60] {
                for has_help in [false, true] {
                    let view = View { has_help, scroll: 7, ..View::default() };
                    let drawn = screen(width, height, clients, &view, false);
                    let mut cells = drawn.buffer().content().iter();
                    assert!(cells.all(|cell| cell.fg == Color::Reset && cell.bg == Color::Reset));
                }
            }
        }
        let coloured = screen(80, 24, 1, &View::default(), true);
        assert!(coloured.buffer().content().iter().any(|cell| cell.fg == Color::Green));
    }

    #[test]
    fn a_table_that_is_longer_than_the_screen_scrolls() {
        let view = |scroll| View { scroll, ..View::default() };
        let rows = |scroll| lines(&screen(80, 24, 60, &view(scroll), false))[7..23].concat();
        assert!(rows(0).contains("falling_b #1") && !rows(5).contains("falling_b #1"));
        assert_eq!(rows(1000), rows(usize::MAX / 2), "the last rows");
        assert!(lines(&screen(80, 24, 60, &view(0), false))[23].contains("61 rows"));
    }

    #[test]
    fn what_is_typed_and_chosen_is_shown() {
        let mut view = View { is_typing: true, ..View::default() };
        view.selection.filter = "ga".to_owned();
        let typing = lines(&screen(80, 24, 9, &view, false));
        assert!(typing[23].starts_with("filter: ga_"));
        assert!(typing[7].starts_with("game #2") && typing[8].starts_with(" scene 4"));
        assert_eq!(typing[9].trim(), "");
        view.is_typing = false;
        view.selection.filter = "nobody".to_owned();
        view.selection.sort = SortKey::Name;
        view.is_paused = true;
        let shown = lines(&screen(80, 24, 9, &view, false));
        assert!(shown[7].contains("no client has 'nobody'") && shown[6].starts_with("*CLIENT"));
        assert!(shown[0].contains("paused") && shown[23].contains("sort: name"));
    }
}
