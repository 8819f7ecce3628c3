//! The figures as SVG: a bar for each way, and below them the time of a tick by the number of boxes.

use std::fmt::Write as _;

use pairmask_core::EngineChoice;

use super::report::{Report, grouped, host_text};
use crate::advise::{Host, Sample, Sizes, Way, take_overs};
use crate::cli::output::time_text;

const WIDTH: f64 = 860.0;
const MARGIN: f64 = 24.0;
/// Where bars begin, and where they end at most.
const BARS: [f64; 2] = [350.0, 700.0];
const ROW: f64 = 26.0;
/// Rows at most.
const MOST_ROWS: usize = 12;
/// Height of the chart of sizes, and where its lines begin and end.
const CHART: f64 = 250.0;
const LINES: [f64; 2] = [90.0, 620.0];
const BACKGROUND: &str = "#14161b";
const TEXT: &str = "#d7dae0";
const DIM: &str = "#8b919c";
const BEST: &str = "#f0c24b";
const BAR: &str = "#5b7db8";
const NEAR: &str = "#4a4f5a";
/// Of lines: a colour for each host, dashes for its settings.
fn style(way: &Way) -> (&'static str, &'static str) {
    let colour = match way.host {
        Host::InProcess => BEST,
        Host::Daemon => BAR,
        Host::Gpu => "#6cc26a",
    };
    let dashes = match (way.engine, way.threads) {
        (EngineChoice::Only(_), _) | (_, Some(1)) => "6 4",
        (_, Some(_)) => "2 3",
        (_, None) => "",
    };
    (colour, dashes)
}

/// A picture that grows downwards.
struct Picture {
    parts: String,
    y: f64,
}

pub fn svg(report: &Report<'_>) -> String {
    let mut picture = Picture { parts: String::new(), y: 42.0 };
    picture.text([MARGIN, 42.0], 17, TEXT, "start", &report.verdict_of_picture());
    for line in std::iter::once(report.work()).chain([report.machine_line()]) {
        picture.y += 22.0;
        picture.text([MARGIN, picture.y], 13, DIM, "start", &line);
    }
    picture.y += 20.0;
    bars(&mut picture, report);
    if report.advice.sizes.rows.len() > 1 {
        sizes(&mut picture, &report.advice.sizes);
    }
    let height = picture.y + MARGIN;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" \
         font-family=\"ui-sans-serif,system-ui,Helvetica,Arial,sans-serif\">\n<title>{}</title>\n\
         <rect width=\"{WIDTH}\" height=\"{height:.0}\" rx=\"6\" fill=\"{BACKGROUND}\"/>\n{}</svg>\n",
        escaped(&report.verdict()),
        picture.parts
    )
}

impl Report<'_> {
    fn verdict_of_picture(&self) -> String {
        let best = self.best();
        format!("{}: {} a tick", best.way, time_text(best.figures.usual_ns))
    }
}

fn bars(picture: &mut Picture, report: &Report<'_>) {
    let rows: Vec<usize> = report.rows(true).into_iter().take(MOST_ROWS).collect();
    let samples = &report.advice.samples;
    let most = rows.iter().map(|at| samples[*at].figures.p99_ns).max().unwrap_or(1).max(1);
    // A single slow tick is not to make all bars short.
    let usual = rows.iter().map(|at| samples[*at].figures.usual_ns).max().unwrap_or(1).max(1);
    let most = most.min(3 * usual) as f64;
    let x = |ns: u64| BARS[0] + (BARS[1] - BARS[0]) * (ns as f64 / most).min(1.0);
    let head = picture.y + 14.0;
    picture.text([BARS[0], head], 12, DIM, "start", "a tick; line: p99; grey: pairs may be near");
    picture.text([WIDTH - MARGIN, head], 12, DIM, "end", "cpu");
    picture.y += 20.0;
    for at in rows {
        let Sample { way, figures, .. } = &samples[at];
        let (is_best, middle) = (at == report.advice.best, picture.y + ROW / 2.0);
        let colour = match (is_best, way.is_near()) {
            (true, _) => BEST,
            (false, true) => NEAR,
            (false, false) => BAR,
        };
        let (name, label) = (if is_best { BEST } else { TEXT }, middle + 4.5);
        picture.text([BARS[0] - 12.0, label], 13, name, "end", &way.to_string());
        let end = x(figures.usual_ns);
        picture.rect([BARS[0], middle - 8.0], [(end - BARS[0]).max(1.0), 16.0], colour);
        let line_end = x(figures.p99_ns);
        picture.line([end, middle], [line_end, middle], DIM, "");
        // One that leaves the picture has no end there.
        if line_end < BARS[1] {
            picture.line([line_end, middle - 4.0], [line_end, middle + 4.0], DIM, "");
        }
        let after = x(figures.usual_ns.max(figures.p99_ns)) + 8.0;
        picture.text([after, label], 13, name, "start", &time_text(figures.usual_ns));
        picture.text([WIDTH - MARGIN, label], 12, DIM, "end", &time_text(figures.cpu_ns));
        picture.y += ROW;
    }
}

fn sizes(picture: &mut Picture, sizes: &Sizes) {
    picture.y += 44.0;
    picture.text([MARGIN, picture.y], 14, TEXT, "start", "A tick by the number of boxes");
    let (top, bottom) = (picture.y + 20.0, picture.y + CHART);
    let all = || sizes.rows.iter().flat_map(|(_, ns)| ns).map(|ns| (*ns).max(1) as f64);
    let low = all().fold(f64::INFINITY, f64::min).log10().floor();
    let high = all().fold(1.0, f64::max).log10().ceil().max(low + 1.0);
    let y = |ns: f64| bottom - (bottom - top) * (ns.max(1.0).log10() - low) / (high - low);
    let boxes = |n: usize| (n.max(1) as f64).log10();
    let (first, last) = (boxes(sizes.rows[0].0), boxes(sizes.rows[sizes.rows.len() - 1].0));
    let x = |n: usize| LINES[0] + (LINES[1] - LINES[0]) * (boxes(n) - first) / (last - first);
    for decade in low as i32..=high as i32 {
        let ns = 10f64.powi(decade);
        picture.line([LINES[0], y(ns)], [LINES[1], y(ns)], "#2a2e37", "");
        picture.text([LINES[0] - 8.0, y(ns) + 4.0], 11, DIM, "end", &round_time(ns as u64));
    }
    for (n, _) in &sizes.rows {
        picture.text([x(*n), bottom + 18.0], 11, DIM, "middle", &grouped(*n));
    }
    for takeover in take_overs(sizes).iter().filter(|takeover| takeover.from > 0) {
        let at = x(takeover.from);
        picture.line([at, top], [at, bottom], DIM, "3 3");
    }
    // Names stand at the ends of lines, one below the other.
    let mut ends: Vec<(f64, usize)> = (0..sizes.ways.len())
        .map(|way| (y(sizes.rows[sizes.rows.len() - 1].1[way] as f64), way))
        .collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let lowest = bottom - 16.0 * ends.len() as f64;
    let mut free = top - 4.0;
    for (rank, (end, way)) in ends.into_iter().enumerate() {
        let (colour, dashes) = style(&sizes.ways[way]);
        let points: Vec<[f64; 2]> =
            sizes.rows.iter().map(|(n, ns)| [x(*n), y(ns[way] as f64)]).collect();
        picture.polyline(&points, colour, dashes);
        let label = end.max(free).min(lowest + 16.0 * rank as f64 + 12.0);
        free = label + 16.0;
        picture.line([LINES[1] + 14.0, label], [LINES[1] + 40.0, label], colour, dashes);
        let name = host_text(&sizes.ways[way]);
        picture.text([LINES[1] + 46.0, label + 4.0], 12, TEXT, "start", &name);
    }
    picture.y = bottom + 24.0;
}

/// A power of ten as an axis has it.
fn round_time(ns: u64) -> String {
    time_text(ns).replace(".0 ", " ")
}

impl Picture {
    fn text(&mut self, [x, y]: [f64; 2], size: u32, fill: &str, anchor: &str, text: &str) {
        let text = escaped(text);
        let _ = writeln!(
            self.parts,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{fill}\" text-anchor=\"{anchor}\">{text}</text>"
        );
    }

    fn rect(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], fill: &str) {
        let _ = writeln!(
            self.parts,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"2\" fill=\"{fill}\"/>"
        );
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: &str, dashes: &str) {
        self.polyline(&[from, to], stroke, dashes);
    }

    fn polyline(&mut self, points: &[[f64; 2]], stroke: &str, dashes: &str) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let points = points.join(" ");
        let _ = writeln!(
            self.parts,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{stroke}\" stroke-width=\"1.5\" stroke-dasharray=\"{dashes}\"/>"
        );
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
