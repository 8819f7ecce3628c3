//! The demo's picture: a slice of the world from the side, and figures beside it. A pure function of both.

use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Rectangle};
use ratatui::widgets::{Block, Paragraph, Widget, Wrap};

use super::figures::{Figures, Kill, Medians, ratio_text};
use super::world::World;
use crate::cli::output::time_text;

const FREE: Color = Color::Blue;
const IN_PAIR: Color = Color::Yellow;
const OURS: Color = Color::Green;
const OTHERS: Color = Color::Red;
/// Columns of the figures, and of the picture at least.
const FIGURES_WIDTH: u16 = 34;
const PICTURE_WIDTH: u16 = 20;
/// Dots of a character: two columns of four.
const DOTS: [f32; 2] = [2.0, 4.0];
/// Share of the view's height that is seen below the platform.
const BELOW: f32 = 0.12;

/// Draws into a buffer of any size.
pub fn draw(buffer: &mut Buffer, world: &World, figures: &Figures) {
    let [title, rest] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(buffer.area);
    title_of(figures, title.width).render(title, buffer);
    if rest.width < FIGURES_WIDTH + PICTURE_WIDTH {
        draw_figures(buffer, figures, rest);
        return;
    }
    let columns = [Constraint::Min(PICTURE_WIDTH), Constraint::Length(FIGURES_WIDTH)];
    let [picture, beside] = Layout::horizontal(columns).areas(rest);
    draw_world(buffer, world, picture);
    draw_figures(buffer, figures, beside);
}

fn title_of(figures: &Figures, width: u16) -> Line<'static> {
    let left = " pairmask demo: falling boxes, every overlapping pair, every frame";
    let right =
        format!("{:.1} of {:.0} s ", figures.elapsed.as_secs_f64(), figures.length.as_secs_f64());
    let gap = usize::from(width).saturating_sub(left.len() + right.len()).max(1);
    Line::from(vec![left.bold(), Span::raw(" ".repeat(gap)), right.into()])
}

fn draw_world(buffer: &mut Buffer, world: &World, area: Rect) {
    let block = Block::bordered().title(" a slice from the side ").title_bottom(Line::from(vec![
        " ".into(),
        Span::styled("in a pair", IN_PAIR),
        ", ".into(),
        Span::styled("in none ", FREE),
    ]));
    let inner = block.inner(area);
    let view = world.view();
    // The same scale on both axes, as large as the area allows.
    let [columns, rows] = [f32::from(inner.width) * DOTS[0], f32::from(inner.height) * DOTS[1]];
    let tall = (1.0 + BELOW) * view.height;
    let scale = (view.width / columns.max(1.0)).max(tall / rows.max(1.0));
    let [half_width, height] = [0.5 * scale * columns, scale * rows].map(f64::from);
    let bottom = f64::from(-BELOW * view.height);
    let canvas = Canvas::default()
        .block(block)
        .marker(Marker::Braille)
        .x_bounds([-half_width, half_width])
        .y_bounds([bottom, bottom + height])
        .paint(|context| {
            // A character has one colour, that of what is drawn last: pairs win.
            for with_pairs in [false, true] {
                for (b, _) in world.slice().filter(|(_, is_in_pair)| *is_in_pair == with_pairs) {
                    let [x, z] = [0, 2].map(|axis| f64::from(b.min[axis]));
                    let [width, height] = [0, 2].map(|axis| f64::from(b.max[axis] - b.min[axis]));
                    let color = if with_pairs { IN_PAIR } else { FREE };
                    context.draw(&Rectangle { x, y: z, width, height, color });
                }
                context.layer();
            }
            let end = f64::from(view.platform);
            let platform = Stroke { x1: -end, y1: 0.0, x2: end, y2: 0.0, color: Color::Gray };
            context.draw(&platform);
        });
    canvas.render(area, buffer);
}

fn draw_figures(buffer: &mut Buffer, figures: &Figures, area: Rect) {
    let block = Block::bordered().title(" this machine ");
    let width = block.inner(area).width;
    let text = Paragraph::new(figure_lines(figures, usize::from(width)));
    text.wrap(Wrap { trim: false }).block(block).render(area, buffer);
}

fn figure_lines(figures: &Figures, width: usize) -> Vec<Line<'static>> {
    let medians = figures.medians();
    let mut lines = vec![
        Line::from(format!(" {} boxes, {} pairs", figures.boxes, figures.pairs)),
        Line::from(format!(" by {}", figures.engine_text())),
        Line::default(),
        " A frame, from boxes to pairs".bold().into(),
    ];
    for (name, time, color) in [
        ("pairmask", medians.ours, OURS),
        ("parry3d", medians.parry, OTHERS),
        ("naive", medians.naive, OTHERS),
    ] {
        lines.push(bar(name, time, &medians, color, width));
    }
    lines.extend([
        Line::default(),
        " This machine".bold().into(),
        ratio_line(&medians, medians.parry, "parry3d's tree"),
        ratio_line(&medians, medians.naive, "a naive loop"),
        " on one thread each".dim().into(),
        Line::default(),
        format!(" {} frames, none lost", figures.frames).into(),
        format!(" {} checked, all right", figures.checked).into(),
        Line::default(),
    ]);
    lines.extend(kill_lines(figures));
    lines
}

fn ratio_line(medians: &Medians, other: Option<u64>, name: &str) -> Line<'static> {
    let ratio = medians.ratio(other).map_or_else(|| "…".to_owned(), ratio_text);
    Line::from(vec![
        Span::styled(format!(" {ratio:>6} "), Style::new().bold()),
        name.to_owned().into(),
    ])
}

/// A name, its time, and a bar: parry3d's fills half of the room, and longer ones end with an arrow.
fn bar(
    name: &str,
    time: Option<u64>,
    medians: &Medians,
    color: Color,
    width: usize,
) -> Line<'static> {
    let text = format!(" {name:<8} {:>8} ", time.map_or_else(|| "…".to_owned(), time_text));
    let room = width.saturating_sub(text.chars().count() + 1);
    let unit = medians.parry.or(medians.ours);
    let eighths = match (time, unit) {
        (Some(time), Some(unit)) => (4.0 * room as f64 * time as f64 / unit as f64).round(),
        _ => 0.0,
    };
    let bar = if eighths > 8.0 * room as f64 {
        "█".repeat(room.saturating_sub(1)) + "▶"
    } else {
        // The least bar is seen too.
        let eighths = if time.is_some() { (eighths as usize).max(1) } else { 0 };
        let part = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"][eighths % 8];
        "█".repeat(eighths / 8) + part
    };
    Line::from(vec![text.into(), Span::styled(bar, color)])
}

fn kill_lines(figures: &Figures) -> Vec<Line<'static>> {
    let seconds = |at: std::time::Duration| format!("{:.1} s", at.as_secs_f64());
    match figures.kill {
        Kill::Ahead => {
            vec![format!(" At {} the worker is killed.", seconds(figures.length / 2)).dim().into()]
        }
        Kill::Done { at } => vec![
            Line::styled(format!(" Worker killed at {}.", seconds(at)), Color::Red),
            " This process answers.".into(),
        ],
        Kill::Back { at } => vec![
            format!(" Worker killed at {}:", seconds(at)).into(),
            format!(" {} in process, then", frames(figures.frames_in_process)).into(),
            Line::from(vec![
                Span::styled(" the next worker. ", OURS),
                Span::styled("No frame lost.", Style::new().fg(OURS).bold()),
            ]),
        ],
    }
}

fn frames(count: u64) -> String {
    if count == 1 { "1 frame".to_owned() } else { format!("{count} frames") }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use pairmask_core::EngineName;
    use pairmask_core::oracle::truth;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;

    /// A demo of which so many seconds have passed.
    fn state(seconds: u64) -> (World, Figures) {
        let mut world = World::new(600, 1);
        for _ in 0..seconds * 60 {
            world.step();
            let pairs = truth(world.boxes()).pairs;
            world.push_apart(&pairs);
        }
        let mut figures = Figures::new(600, Duration::from_secs(10));
        figures.elapsed = Duration::from_secs(seconds);
        figures.parry.record(612_000);
        figures.naive.record(9_100_000);
        figures.checked = 7;
        for _ in 0..300 {
            let engine = EngineName::CpuGrid.into();
            figures.note_frame(2345, Duration::from_micros(100), engine, false);
        }
        (world, figures)
    }

    fn drawn(width: u16, height: u16, world: &World, figures: &Figures) -> Buffer {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a test's");
        terminal.draw(|frame| draw(frame.buffer_mut(), world, figures)).expect("a test's");
        terminal.backend().buffer().clone()
    }

    fn text(buffer: &Buffer) -> String {
        let rows = buffer.content().chunks(usize::from(buffer.area.width).max(1));
        let row = |cells: &[ratatui::buffer::Cell]| {
            cells.iter().map(ratatui::buffer::Cell::symbol).collect::<String>()
        };
        rows.map(row).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn a_terminal_of_any_size_has_boxes_beside_the_figures() {
        let (world, mut figures) = state(3);
        for (width, height) in [(80, 24), (160, 50)] {
            let buffer = drawn(width, height, &world, &figures);
            let text = text(&buffer);
            for part in [
                "3.0 of 10 s",
                "600 boxes, 2345 pairs",
                "by cpu-grid",
                " pairmask 100.0 µs ",
                " parry3d  612.4 µs ",
                "▶",
                "  6.1 × parry3d's tree",
                "   91 × a naive loop",
                "300 frames, none lost",
                "7 checked, all right",
                "At 5.0 s the worker is killed.",
            ] {
                assert!(text.contains(part), "{width} × {height}: no '{part}' in\n{text}");
            }
            let dots = |color| {
                let is_dots = |cell: &&ratatui::buffer::Cell| {
                    cell.fg == color && ('\u{2801}'..='\u{28ff}').contains(&first(cell.symbol()))
                };
                buffer.content().iter().filter(is_dots).count()
            };
            assert!(dots(IN_PAIR) > 30 && dots(FREE) > 10, "{text}");
            assert!(dots(Color::Gray) >= usize::from(width) / 3, "the platform\n{text}");
        }
        figures.kill = Kill::Done { at: Duration::from_secs(5) };
        assert!(text(&drawn(80, 24, &world, &figures)).contains("Worker killed at 5.0 s."));
        figures.kill = Kill::Back { at: Duration::from_secs(5) };
        figures.frames_in_process = 1;
        let text = text(&drawn(80, 24, &world, &figures));
        assert!(
            text.contains(" 1 frame in process, then ") && text.contains("No frame lost."),
            "{text}"
        );
    }

    fn first(symbol: &str) -> char {
        symbol.chars().next().unwrap_or(' ')
    }

    #[test]
    fn a_terminal_that_is_small_is_drawn_as_far_as_it_goes() {
        let (world, figures) = state(0);
        for (width, height) in [(0, 0), (1, 1), (7, 3), (53, 9), (54, 2), (300, 4)] {
            drawn(width, height, &world, &figures);
        }
        assert!(text(&drawn(40, 20, &world, &figures)).contains("parry3d"));
    }
}
