//! Plots of measurements as SVG, on logarithmic axes: lines, ranges, points with their Pareto front; and stacked
//! bars.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub use super::unit::Unit;

/// Colours of series. They are Okabe and Ito's, which differ for readers who do not tell red from green; the
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
const GREY: RGBColor = RGBColor(0x99, 0x99, 0x99);
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);

/// Width of a plot and height without its key, px.
const SIZE: (u32, u32) = (640, 400);
/// Height of a row of the key, and of a bar with the gap behind it, px.
const ROW: u32 = 20;
/// Names in a row of the key.
const KEY_COLUMNS: usize = 2;
/// Part of a logarithmic axis that is kept for the value zero, in decades.
const ZERO_LANE: f64 = 0.5;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// What an axis counts.
#[derive(Clone, Debug)]
pub struct Axis {
    /// In words.
    pub label: String,
    /// How its numbers are written.
    pub unit: Unit,
}

impl Axis {
    /// An axis.
    pub fn new(label: &str, unit: Unit) -> Self {
        Self { label: label.to_owned(), unit }
    }
}

/// How a series looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// A line through points, in the series' colour.
    Line,
    /// Other authors' line: grey and dashed.
    Others,
    /// Points alone.
    Points,
    /// A dashed line through the corners between points, which stands in no key.
    Front,
}

/// One measurement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Along the axis of x.
    pub x: f64,
    /// Along the axis of y.
    pub y: f64,
    /// The upper end of a range that begins at y.
    pub high: Option<f64>,
    /// Name beside the point; empty for none.
    pub tag: String,
    /// Whether the point is a ring.
    pub is_hollow: bool,
    /// Whether the point is grey.
    pub is_faded: bool,
}

/// Points of one colour.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the key.
    pub name: String,
    /// Its colour: series of the same number look the same in every plot of a page.
    pub colour: usize,
    /// How it looks.
    pub look: Look,
    /// Its points, in order.
    pub points: Vec<Point>,
}

impl Series {
    /// A line.
    pub fn line(name: &str, colour: usize, look: Look, points: &[(f64, f64)]) -> Self {
        let point = |&(x, y): &(f64, f64)| Point { x, y, ..Point::default() };
        Self { name: name.to_owned(), colour, look, points: points.iter().map(point).collect() }
    }

    fn colour(&self) -> RGBColor {
        match self.look {
            Look::Others => GREY,
            Look::Front => INK,
            Look::Line | Look::Points => COLOURS[self.colour % COLOURS.len()],
        }
    }
}

/// Series on logarithmic axes.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Title.
    pub title: String,
    /// The axis of x.
    pub x: Axis,
    /// The axis of y.
    pub y: Axis,
    /// What is drawn, the first first.
    pub series: Vec<Series>,
    /// A horizontal line that separates good from bad, and its name.
    pub level: Option<(f64, String)>,
}

/// A logarithmic scale: the place of a value is its logarithm, that of zero a lane before the least.
#[derive(Clone)]
struct Scale {
    from: f64,
    to: f64,
    zero: Option<f64>,
}

impl Scale {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let (mut least, mut most, mut has_zero) = (f64::INFINITY, f64::NEG_INFINITY, false);
        for value in values.filter(|value| value.is_finite()) {
            if value > 0.0 {
                (least, most) = (least.min(value.log10()), most.max(value.log10()));
            } else {
                has_zero = true;
            }
        }
        if least > most {
            (least, most) = (-1.0, 0.0);
        }
        let room = 0.04 * (most - least).max(1.0);
        let zero = has_zero.then_some(least - ZERO_LANE);
        Self { from: zero.unwrap_or(least) - room, to: most + room, zero }
    }

    fn place(&self, value: f64) -> f64 {
        if value > 0.0 { value.log10() } else { self.zero.unwrap_or(self.from) }
    }

    /// Round numbers: 1, 2 and 5 times powers of ten, or powers alone where there are many; and zero.
    fn marks(&self) -> Vec<f64> {
        let factors: &[f64] = if self.to - self.from < 3.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let powers = self.from.floor() as i32..=self.to.ceil() as i32;
        let every = ((self.to - self.from) / 9.0) as usize + 1;
        let marks = powers
            .step_by(every)
            .flat_map(|power| factors.iter().map(move |f| f * 10f64.powi(power)));
        let least = self.zero.map_or(self.from, |zero| zero + ZERO_LANE / 2.0);
        let is_inside = |mark: &f64| (least..=self.to).contains(&mark.log10());
        self.zero.map(|_| 0.0).into_iter().chain(marks.filter(is_inside)).collect()
    }
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        let share = (self.place(*value) - self.from) / (self.to - self.from);
        start + (share * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.marks() }
    }

    fn range(&self) -> Range<f64> {
        10f64.powf(self.from)..10f64.powf(self.to)
    }
}

impl Plot {
    fn key(&self) -> impl Iterator<Item = (&str, RGBColor)> {
        let named = self.series.iter().filter(|series| series.look != Look::Front);
        named.map(|series| (series.name.as_str(), series.colour()))
    }

    fn height(&self) -> u32 {
        SIZE.1 + ROW * self.key().count().div_ceil(KEY_COLUMNS) as u32
    }

    /// The plot as one `<svg>` element.
    pub fn svg(&self) -> String {
        drawn_as_svg(self.height(), |area| self.draw(area))
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = Scale::of(points().map(|point| point.x));
        let level = self.level.iter().map(|(at, _)| *at);
        let y = Scale::of(points().flat_map(|p| [p.y, p.high.unwrap_or(p.y)]).chain(level));
        let (upper, key) = area.split_vertically(SIZE.1);
        let mut chart = ChartBuilder::on(&upper)
            .caption(&self.title, ("sans-serif", 18).into_font().color(&INK))
            .margin_right(16)
            .x_label_area_size(42)
            .y_label_area_size(78)
            .build_cartesian_2d(x.clone(), y)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .label_style(("sans-serif", 15).into_font().color(&INK))
            .x_label_formatter(&|x| self.x.unit.text(*x))
            .y_label_formatter(&|y| self.y.unit.text(*y))
            .draw()?;
        let at = |point: &Point| (point.x, point.y);
        let mut tags = Vec::new();
        if let Some((level, name)) = &self.level {
            let ends = [(x.range().start, *level), (x.range().end, *level)];
            chart.draw_series(DashedLineSeries::new(ends, 2, 3, INK.stroke_width(1)))?;
            tags.push((chart.backend_coord(&ends[0]), name, INK));
        }
        for series in &self.series {
            let colour = series.colour();
            let path = series.points.iter().map(&at);
            match series.look {
                Look::Line => {
                    chart.draw_series(LineSeries::new(path, colour.stroke_width(2)))?;
                }
                Look::Others | Look::Front => {
                    let style = colour.stroke_width(2);
                    chart.draw_series(DashedLineSeries::new(path, 5, 4, style))?;
                }
                Look::Points => {}
            }
            for point in series.points.iter().filter(|_| series.look != Look::Front) {
                let (place, colour) = (at(point), if point.is_faded { GREY } else { colour });
                if let Some(high) = point.high {
                    let range = [place, (place.0, high)];
                    let style = colour.mix(0.5).stroke_width(3);
                    chart.draw_series([PathElement::new(range, style)])?;
                }
                let style = if point.is_hollow { colour.stroke_width(2) } else { colour.filled() };
                chart.draw_series([Circle::new(place, 4, style)])?;
                if !point.tag.is_empty() {
                    tags.push((chart.backend_coord(&place), &point.tag, colour));
                }
            }
        }
        draw_tags(&upper, &tags)?;
        draw_key(&key, self.key().collect())
    }
}

/// Names beside their points, each off the names before it as far as there is room below.
fn draw_tags(area: &Area<'_>, tags: &[((i32, i32), &String, RGBColor)]) -> Drawn {
    let (left, top) = area.get_base_pixel();
    let mut taken: Vec<[i32; 3]> = Vec::new();
    for ((x, y), text, colour) in tags {
        let width = 7 * text.chars().count() as i32;
        let fits_right = x - left + 8 + width < SIZE.0 as i32;
        let from = if fits_right { x - left + 8 } else { x - left - 8 - width };
        let is_free = |line: i32, taken: &[[i32; 3]]| {
            taken.iter().all(|[l, r, at]| from > *r || from + width < *l || (line - at).abs() > 11)
        };
        let lines = [0, -12, 12, -24, 24, 36, 48].map(|by| y - top - 6 + by);
        let Some(line) = lines.into_iter().find(|line| is_free(*line, &taken)) else { continue };
        taken.push([from, from + width, line]);
        let style = ("sans-serif", 13).into_font().color(colour);
        area.draw(&Text::new((*text).clone(), (from, line), style))?;
    }
    Ok(())
}

fn draw_key(area: &Area<'_>, key: Vec<(&str, RGBColor)>) -> Drawn {
    let width = (SIZE.0 - 84) as usize / KEY_COLUMNS;
    for (i, (name, colour)) in key.into_iter().enumerate() {
        let (left, top) =
            (84 + (i % KEY_COLUMNS * width) as i32, (i / KEY_COLUMNS) as i32 * ROW as i32);
        area.draw(&Rectangle::new([(left, top + 1), (left + 10, top + 11)], colour.filled()))?;
        let style = ("sans-serif", 15).into_font().color(&INK);
        area.draw(&Text::new(name.to_owned(), (left + 15, top), style))?;
    }
    Ok(())
}

fn drawn_as_svg(height: u32, draw: impl FnOnce(&Area<'_>) -> Drawn) -> String {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (SIZE.0, height)).into_drawing_area();
    // Writing to a String cannot fail.
    let _ = area.fill(&WHITE).and_then(|()| draw(&area)).and_then(|()| area.present());
    drop(area);
    svg
}

/// Plots below each other as the text of an SVG file, below a title and lines that say what is shown.
pub fn standalone(title: &str, lines: &[String], plots: &[Plot]) -> String {
    let head = 48 + 17 * lines.len() as u32;
    let height = head + plots.iter().map(|plot| plot.height() + ROW).sum::<u32>();
    drawn_as_svg(height, |area| {
        let text = |text: &str, y: u32, size: u32| {
            let style = ("sans-serif", size).into_font().color(&INK);
            area.draw(&Text::new(text.to_owned(), (24, y as i32), style))
        };
        text(title, 10, 21)?;
        for (i, line) in lines.iter().enumerate() {
            text(line, 36 + 17 * i as u32, 15)?;
        }
        let mut rest = area.split_vertically(head).1;
        for plot in plots {
            let (own, below) = rest.split_vertically(plot.height() + ROW);
            plot.draw(&own)?;
            rest = below;
        }
        Ok(())
    })
}

/// Horizontal bars, each of the same parts.
#[derive(Clone, Debug)]
pub struct Bars {
    /// Title.
    pub title: String,
    /// Names of the parts.
    pub parts: Vec<String>,
    /// How values are written.
    pub unit: Unit,
    /// Names of the bars, from the top, and their parts.
    pub bars: Vec<(String, Vec<f64>)>,
}

impl Bars {
    /// The plot as one `<svg>` element.
    pub fn svg(&self) -> String {
        let body = 34 + ROW * self.bars.len() as u32;
        let height = body + ROW * (1 + self.parts.len().div_ceil(KEY_COLUMNS) as u32);
        drawn_as_svg(height, |area| {
            let sum = |parts: &[f64]| parts.iter().sum::<f64>();
            let longest = self.bars.iter().map(|(_, parts)| sum(parts)).fold(1e-300, f64::max);
            // Room for the names on the left and the sums on the right.
            let px = |value: f64| 240 + (f64::from(SIZE.0 - 310) * value / longest) as i32;
            let label = ("sans-serif", 15).into_font().color(&INK);
            let on_the_left = label.pos(Pos::new(HPos::Right, VPos::Top));
            let title = ("sans-serif", 18).into_font().color(&INK);
            area.draw(&Text::new(self.title.clone(), (10, 8), title))?;
            for ((name, parts), y) in self.bars.iter().zip((34i32..).step_by(ROW as usize)) {
                area.draw(&Text::new(name.clone(), (232, y + 2), on_the_left.clone()))?;
                let mut start = 0.0;
                for (part, value) in parts.iter().enumerate() {
                    let colour = COLOURS[part % COLOURS.len()].filled();
                    let corners = [(px(start), y), (px(start + value), y + 15)];
                    area.draw(&Rectangle::new(corners, colour))?;
                    start += value;
                }
                let text = self.unit.text(start);
                area.draw(&Text::new(text, (px(start) + 6, y + 2), label.clone()))?;
            }
            let names = self.parts.iter().enumerate();
            let key = names.map(|(i, name)| (name.as_str(), COLOURS[i % COLOURS.len()]));
            draw_key(&area.split_vertically(body + 8).1, key.collect())
        })
    }
}

/// For each point, whether it is on the Pareto front: no other point is at most as large on every axis and
/// smaller on one. Equal points are on the front together; a NaN never is.
///
/// ```
/// use pairmask_lab::study::harness::plot::pareto_front;
/// let front = pareto_front(&[[1.0, 5.0], [2.0, 2.0], [3.0, 2.0], [4.0, 1.0]]);
/// assert_eq!(front, [true, true, false, true]);
/// assert_eq!(pareto_front(&[[1.0, 1.0], [1.0, 1.0], [f64::NAN, 0.0]]), [true, true, false]);
/// ```
pub fn pareto_front<const AXES: usize>(points: &[[f64; AXES]]) -> Vec<bool> {
    let beats = |a: &[f64; AXES], b: &[f64; AXES]| a != b && a.iter().zip(b).all(|(a, b)| a <= b);
    let is_beaten = |p: &[f64; AXES]| points.iter().any(|other| beats(other, p));
    points.iter().map(|p| !p.iter().any(|x| x.is_nan()) && !is_beaten(p)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers_are_marked_and_zero_has_a_lane_of_its_own() {
        let labels = |values: &[f64], unit: Unit| {
            let scale = Scale::of(values.iter().copied());
            let marks = scale.marks();
            let places = marks.iter().map(|mark| scale.place(*mark));
            assert!(places.clone().all(|at| (scale.from..=scale.to).contains(&at)), "{marks:?}");
            marks.into_iter().map(|mark| unit.text(mark)).collect::<Vec<_>>()
        };
        assert_eq!(
            labels(&[0.0, 3e-4, 20.0], Unit::Ratio),
            ["0", "0.001", "0.01", "0.1", "1", "10"]
        );
        assert_eq!(labels(&[1.9e6, 5.1e6], Unit::Nanoseconds), ["2 ms", "5 ms"]);
        assert!(!labels(&[], Unit::Count).is_empty() && !labels(&[1.0], Unit::Count).is_empty());
    }

    #[test]
    fn a_file_has_all_plots_their_names_and_escaped_text() {
        let plot = Plot {
            title: "a < b".to_owned(),
            x: Axis::new("boxes", Unit::Count),
            y: Axis::new("time", Unit::Nanoseconds),
            series: vec![
                Series::line("ours", 0, Look::Line, &[(10.0, 100.0), (100.0, 1e3)]),
                Series::line("theirs", 0, Look::Others, &[(0.0, 100.0), (100.0, 1e3)]),
                Series::line("nothing", 1, Look::Points, &[]),
            ],
            level: Some((500.0, "as fast".to_owned())),
        };
        let file = standalone("all & sundry", &["a line".to_owned()], &[plot.clone(), plot]);
        assert_eq!(file.matches("<svg").count(), 1, "plots are parts of one element");
        for (text, count) in
            [("a &lt; b", 2), ("all &amp; sundry", 1), ("a line", 1), ("theirs", 2), ("as fast", 2)]
        {
            assert_eq!(file.matches(text).count(), count, "{text}: {file}");
        }
        assert!(file.trim_end().ends_with("</svg>") && !file.contains("NaN"));
    }

    #[test]
    fn bars_have_their_sums() {
        let svg = Bars {
            title: String::new(),
            parts: vec!["ingest".to_owned(), "execute".to_owned()],
            unit: Unit::Nanoseconds,
            bars: vec![
                ("long".to_owned(), vec![300.0, 100.0]),
                ("short".to_owned(), vec![0.0, 40.0]),
            ],
        };
        let svg = svg.svg();
        for text in ["ingest", "execute", "long", "short", "400 ns", "40 ns"] {
            assert!(svg.contains(text), "{text}: {svg}");
        }
    }
}
