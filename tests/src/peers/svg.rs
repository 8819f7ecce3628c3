//! The scaling plot: ratio to the best peer over the number of boxes, one line a scene, one panel a
//! backend. Both axes are logarithmic.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use super::line::{Comparison, Row};

/// One panel, px.
const PANEL: [f64; 2] = [420.0, 320.0];
/// Room around a panel for its labels, px: left, top.
const MARGIN: [f64; 2] = [60.0, 40.0];
/// Room for the names of the scenes, px.
const LEGEND: f64 = 130.0;
/// Colours of the lines; a fifteenth scene would begin again.
const COLOURS: [&str; 14] = [
    "#1b6ca8", "#d1495b", "#2e933c", "#e08e0b", "#7b4fa3", "#0f9da8", "#9c6b30", "#5b6770",
    "#c2185b", "#6d8b00", "#3f51b5", "#b23c17", "#00796b", "#8d6e63",
];

/// A logarithmic axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    low: f64,
    high: f64,
    length: f64,
}

impl Axis {
    /// Over all values, widened to whole powers of ten.
    fn over(values: impl Iterator<Item = f64>, length: f64) -> Self {
        let logs = values.filter(|v| *v > 0.0).map(f64::log10);
        let (low, high) = logs.fold((0.0f64, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        Self { low: low.floor(), high: high.ceil().max(low.floor() + 1.0), length }
    }

    fn at(self, value: f64) -> f64 {
        (value.log10() - self.low) / (self.high - self.low) * self.length
    }

    fn ticks(self) -> impl Iterator<Item = f64> {
        (self.low as i32..=self.high as i32).map(|power| 10f64.powi(power))
    }
}

/// The plot.
pub fn plot(comparisons: &[Comparison]) -> String {
    let rows: Vec<Row> =
        comparisons.iter().flat_map(Comparison::rows).filter(|row| row.is_best_peer).collect();
    let most_threads = rows.iter().map(|row| row.threads).max().unwrap_or(1);
    let rows: Vec<Row> = rows.into_iter().filter(|row| row.threads == most_threads).collect();
    let panels: BTreeSet<(&str, &str)> =
        rows.iter().map(|row| (row.backend, row.engine.split(':').next().unwrap_or(""))).collect();
    let scenes: BTreeSet<&str> = rows.iter().map(|row| row.scene.as_str()).collect();
    let fewest = rows.iter().map(|row| row.n as f64).fold(f64::INFINITY, f64::min);
    let x = Axis {
        low: if fewest.is_finite() { fewest.log10().floor() } else { 0.0 },
        ..Axis::over(rows.iter().map(|row| row.n as f64), PANEL[0])
    };
    let y = Axis::over(rows.iter().map(|row| row.ratio), PANEL[1]);

    let width = (PANEL[0] + MARGIN[0]) * panels.len().max(1) as f64 + LEGEND;
    let height = PANEL[1] + 2.0 * MARGIN[1];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (place, (backend, engine)) in panels.iter().enumerate() {
        let left = MARGIN[0] + place as f64 * (PANEL[0] + MARGIN[0]);
        let _ = writeln!(svg, "<g transform=\"translate({left} {})\">", MARGIN[1]);
        let title = format!("{backend}, {engine}, {most_threads} threads: time / best peer's");
        let _ = writeln!(svg, "<text y=\"-12\">{title}</text>");
        axes(&mut svg, x, y);
        let here =
            |row: &&Row| row.backend == *backend && row.engine.split(':').next() == Some(*engine);
        let mut lines: BTreeMap<&str, Vec<(usize, f64)>> = BTreeMap::new();
        for row in rows.iter().filter(here) {
            lines.entry(row.scene.as_str()).or_default().push((row.n, row.ratio));
        }
        for (scene, mut points) in lines {
            points.sort_by_key(|(n, _)| *n);
            line(&mut svg, &points, colour(&scenes, scene), x, y);
        }
        svg.push_str("</g>\n");
    }
    for (place, scene) in scenes.iter().enumerate() {
        let (left, top) = (width - LEGEND + 10.0, MARGIN[1] + 18.0 * place as f64);
        let colour = colour(&scenes, scene);
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"12\" height=\"12\" fill=\"{colour}\"/>\
             <text x=\"{}\" y=\"{}\">{scene}</text>",
            left + 18.0,
            top + 11.0
        );
    }
    svg + "</svg>\n"
}

fn colour(scenes: &BTreeSet<&str>, scene: &str) -> &'static str {
    let place = scenes.iter().position(|s| *s == scene).unwrap_or(0);
    COLOURS[place % COLOURS.len()]
}

fn axes(svg: &mut String, x: Axis, y: Axis) {
    for n in x.ticks() {
        let at = x.at(n);
        let _ = writeln!(
            svg,
            "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"0\" y2=\"{}\" stroke=\"#ddd\"/>\
             <text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{n}</text>",
            PANEL[1],
            PANEL[1] + 18.0
        );
    }
    for ratio in y.ticks() {
        let at = PANEL[1] - y.at(ratio);
        // As fast as the peer.
        let stroke = if ratio == 1.0 { "#333" } else { "#ddd" };
        let _ = writeln!(
            svg,
            "<line x1=\"0\" x2=\"{}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"{stroke}\"/>\
             <text x=\"-8\" y=\"{:.1}\" text-anchor=\"end\">{ratio}</text>",
            PANEL[0],
            at + 4.0
        );
    }
}

fn line(svg: &mut String, points: &[(usize, f64)], colour: &str, x: Axis, y: Axis) {
    let places: Vec<(f64, f64)> =
        points.iter().map(|&(n, ratio)| (x.at(n as f64), PANEL[1] - y.at(ratio))).collect();
    let path: Vec<String> = places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
        path.join(" ")
    );
    for (x, y) in places {
        let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{colour}\"/>");
    }
}
