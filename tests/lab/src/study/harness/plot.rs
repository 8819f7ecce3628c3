//! Plots of measurements as SVG, on logarithmic axes: points, and their Pareto front.

use std::collections::BTreeMap;

use plotters::coord::Shift;
use plotters::prelude::*;

use super::table::{Table, number_text, plain};

/// Colours of series. They are Okabe and Ito's, which differ for readers who do not distinguish red from green; the
/// lightest of them, yellow, is darkened to show on white.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0xa8, 0x9a, 0x00),
    RGBColor(0x77, 0x77, 0x77),
];
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);

/// Width of a plot and height without its key, px.
const SIZE: (u32, u32) = (640, 400);
/// Height of a row of the key, px.
const ROW: u32 = 20;
const KEY_COLUMNS: usize = 2;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// A value of a field, in the unit that its name says.
pub fn value_text(field: &str, value: f64) -> String {
    let steps: &[(f64, &str)] = if field.split('.').any(|part| part.ends_with("_ns")) {
        &[(1e9, " s"), (1e6, " ms"), (1e3, " µs"), (1.0, " ns")]
    } else if field.contains("bytes") {
        &[(1e9, " GB"), (1e6, " MB"), (1e3, " KB"), (1.0, " B")]
    } else if ["n", "threads", "clients", "count"].contains(&field) {
        &[(1e9, "G"), (1e6, "M"), (1e3, "K"), (1.0, "")]
    } else {
        &[(1.0, "")]
    };
    let size = value.abs();
    let found = steps.iter().find(|(step, _)| size >= *step).or(steps.last());
    let (step, name) = found.unwrap_or(&(1.0, ""));
    number_text(value / step) + name
}

#[derive(Clone, Debug)]
pub struct Plot {
    pub title: String,
    /// The fields on its axes.
    pub x: String,
    pub y: String,
    /// Points by the setting that they share, a colour each.
    series: BTreeMap<String, Vec<(f64, f64)>>,
    /// The corners of a dashed line between points, which stands in no key.
    front: Vec<(f64, f64)>,
}

/// The ends of a logarithmic axis. Zeros stand at its lower end, apart from the least value.
fn ends(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (mut least, mut most, mut has_zero) = (f64::INFINITY, 0.0f64, false);
    for value in values.filter(|value| value.is_finite()) {
        if value > 0.0 {
            (least, most) = (least.min(value), most.max(value));
        } else {
            has_zero = true;
        }
    }
    if least > most {
        (least, most) = (0.1, 1.0);
    }
    [least / if has_zero { 5.0 } else { 1.2 }, most * 1.2]
}

impl Plot {
    /// A point for every row of a table that has both numbers, with its Pareto front: between two of its points the
    /// left one is the best known. Rows of one setting of the fields of `by` share a colour.
    pub(crate) fn of(table: &Table, x: &str, y: &str, by: &[&str]) -> Self {
        let mut series: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
        let mut all = Vec::new();
        for row in &table.rows {
            let setting = by.iter().map(|name| match table.cell(row, name) {
                text if text.is_string() => plain(text),
                value => format!("{name} {value}"),
            });
            let setting = setting.collect::<Vec<_>>().join(", ");
            if let Some((x, y)) = table.cell(row, x).as_f64().zip(table.cell(row, y).as_f64()) {
                series.entry(setting).or_default().push((x, y));
                all.push([x, y]);
            }
        }
        let mut best: Vec<[f64; 2]> =
            all.iter().zip(pareto_front(&all)).filter_map(|(p, wins)| wins.then_some(*p)).collect();
        best.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let mut front: Vec<(f64, f64)> = Vec::new();
        for [x, y] in best {
            front.extend(front.last().map(|(_, above)| (x, *above)));
            front.push((x, y));
        }
        let (x, y) = (x.to_owned(), y.to_owned());
        Self { title: format!("{y} by {x}"), x, y, series, front }
    }

    pub(crate) fn svg(&self) -> String {
        let mut svg = String::new();
        let height = SIZE.1 + ROW * self.series.len().div_ceil(KEY_COLUMNS) as u32;
        let area = SVGBackend::with_string(&mut svg, (SIZE.0, height)).into_drawing_area();
        // Writing to a String cannot fail.
        let _ = area.fill(&WHITE).and_then(|()| self.draw(&area)).and_then(|()| area.present());
        drop(area);
        svg
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        let points = || self.series.values().flatten();
        let x = ends(points().map(|(x, _)| *x));
        let y = ends(points().map(|(_, y)| *y));
        let placed = |(at_x, at_y): &(f64, f64)| (at_x.max(x[0]), at_y.max(y[0]));
        let (upper, key) = area.split_vertically(SIZE.1);
        let mut chart = ChartBuilder::on(&upper)
            .caption(&self.title, ("sans-serif", 18).into_font().color(&INK))
            .margin_right(16)
            .x_label_area_size(42)
            .y_label_area_size(78)
            .build_cartesian_2d((x[0]..x[1]).log_scale(), (y[0]..y[1]).log_scale())?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_desc(&self.x)
            .y_desc(&self.y)
            .label_style(("sans-serif", 15).into_font().color(&INK))
            .x_label_formatter(&|x| value_text(&self.x, *x))
            .y_label_formatter(&|y| value_text(&self.y, *y))
            .draw()?;
        let front = DashedLineSeries::new(self.front.iter().map(placed), 5, 4, INK.stroke_width(2));
        chart.draw_series(front)?;
        for (points, colour) in self.series.values().zip(COLOURS.iter().cycle()) {
            let circle = |slot| Circle::new(placed(slot), 4, colour.filled());
            chart.draw_series(points.iter().map(circle))?;
        }
        let width = (SIZE.0 - 84) as usize / KEY_COLUMNS;
        for (i, (name, colour)) in self.series.keys().zip(COLOURS.iter().cycle()).enumerate() {
            let left = 84 + (i % KEY_COLUMNS * width) as i32;
            let top = (i / KEY_COLUMNS) as i32 * ROW as i32;
            let corners = [(left, top + 1), (left + 10, top + 11)];
            key.draw(&Rectangle::new(corners, colour.filled()))?;
            let style = ("sans-serif", 15).into_font().color(&INK);
            key.draw(&Text::new(name.clone(), (left + 15, top), style))?;
        }
        Ok(())
    }
}

/// For each point, whether it is on the Pareto front: no other point is at most as large on every axis and
/// smaller on one. Equal points are on the front together; a NaN never is.
pub(crate) fn pareto_front<const AXES: usize>(points: &[[f64; AXES]]) -> Vec<bool> {
    let beats = |a: &[f64; AXES], b: &[f64; AXES]| a != b && a.iter().zip(b).all(|(a, b)| a <= b);
    let is_beaten = |p: &[f64; AXES]| points.iter().any(|other| beats(other, p));
    points.iter().map(|p| !p.iter().any(|x| x.is_nan()) && !is_beaten(p)).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn zero_stands_apart_from_the_least_number() {
        assert_eq!(ends([0.0, 5.0, 10.0, f64::NAN].into_iter()), [1.0, 12.0]);
        assert!(ends([].into_iter())[0] > 0.0 && ends([1.0].into_iter())[0] < 1.0);
    }

    #[test]
    fn rows_become_points_and_the_front_passes_what_is_beaten() {
        let row = |x: f64, y: f64| json!({"x": x, "y_ns": {"p50": y}, "who": "g"});
        let rows = [row(0.2, 50.0), row(0.0, 100.0), row(0.1, 200.0), json!({"x": 1, "who": "h"})];
        let mut plot = Plot::of(&Table::of(&rows), "x", "y_ns.p50", &["who"]);
        let points = vec![(0.2, 50.0), (0.0, 100.0), (0.1, 200.0)];
        assert_eq!(plot.series, BTreeMap::from([("g".to_owned(), points)]));
        assert_eq!(plot.front, [(0.0, 100.0), (0.2, 100.0), (0.2, 50.0)]);
        plot.title = "a < b".to_owned();
        plot.series.insert("nothing".to_owned(), Vec::new());
        let svg = plot.svg();
        for text in ["<svg", "a &lt; b", "nothing"] {
            assert_eq!(svg.matches(text).count(), 1, "{text}: {svg}");
        }
        assert!(svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"));
        let front = pareto_front(&[[1.0, 1.0], [1.0, 1.0], [f64::NAN, 0.0], [2.0, 1.0]]);
        assert_eq!(front, [true, true, false, false]);
    }
}
