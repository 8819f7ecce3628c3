//! Ranges on logarithmic axes, for plots of scaling with the variation at each point.

use maud::html;

use super::frame::{Axis, Frame, coordinate};
use super::scale::Scale;
use super::unit::Unit;
use super::{Plot, series_class};

/// One series: the lower end of each range is a usual value, the upper end a rare one.
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    /// Its name in the key.
    pub name: String,
    /// Its colour: series of the same number look the same in every plot of a page.
    pub series: usize,
    /// x, and y at the lower and the upper end, in order of x.
    pub points: Vec<(f64, [f64; 2])>,
}

/// Ranges on logarithmic axes: a line through the lower ends, a bar up from each. Series stand side by
/// side where they have the same x.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranges {
    /// Title.
    pub title: String,
    /// What x counts.
    pub x_label: String,
    /// What y counts.
    pub y_label: String,
    /// How x is written.
    pub x_unit: Unit,
    /// How y is written.
    pub y_unit: Unit,
    /// Names of the two ends.
    pub ends: [String; 2],
    /// The series.
    pub ranges: Vec<Range>,
}

/// From one series to the next at the same x, in SVG units.
const APART: f64 = 7.0;
/// Room beside the outermost x, as a factor, so that series beside each other stay inside.
const ROOM: f64 = 1.6;

impl Ranges {
    /// The plot.
    pub fn draw(&self) -> Plot {
        let drawn: Vec<&Range> = self.ranges.iter().filter(|r| !r.points.is_empty()).collect();
        let points = || drawn.iter().flat_map(|range| &range.points);
        let frame = Frame {
            title: &self.title,
            x: Axis {
                label: &self.x_label,
                unit: self.x_unit,
                scale: Scale::log(points().flat_map(|p| [p.0 / ROOM, p.0 * ROOM])),
            },
            y: Axis {
                label: &self.y_label,
                unit: self.y_unit,
                scale: Scale::log(points().flat_map(|p| p.1)),
            },
            key: drawn.iter().map(|range| (series_class(range.series), &*range.name)).collect(),
        };
        let middle = drawn.len().saturating_sub(1) as f64 / 2.0;
        let x_of = |place: usize, x: f64| coordinate(frame.x(x) + APART * (place as f64 - middle));
        let y_of = |y: f64| coordinate(frame.y(y));
        let path = |place: usize, range: &Range| -> String {
            let corner = |&(x, [y, _]): &(f64, [f64; 2])| format!("{} {}", x_of(place, x), y_of(y));
            format!("M{}", range.points.iter().map(corner).collect::<Vec<_>>().join("L"))
        };
        frame.around(&html! {
            @for (place, range) in drawn.iter().enumerate() {
                @let class = series_class(range.series);
                path class=(format!("line thin {class}")) d=(path(place, range)) {}
                @for &(x, [low, high]) in &range.points {
                    @let at = x_of(place, x);
                    line class=(format!("range {class}")) x1=(at) x2=(at) y1=(y_of(low)) y2=(y_of(high)) {}
                    @for (y, (end, r)) in [low, high].into_iter().zip(self.ends.iter().zip(["3.5", "2"])) {
                        circle class=(class) r=(r) cx=(at) cy=(y_of(y)) {
                            title {
                                (range.name) " " (end) ": " (self.x_unit.text(x)) ", " (self.y_unit.text(y))
                            }
                        }
                    }
                }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use maud::Render;

    use super::*;

    #[test]
    fn a_range_has_a_line_below_and_two_marks_a_point() {
        let range = |name: &str, points: &[(f64, [f64; 2])]| Range {
            name: name.to_owned(),
            series: 2,
            points: points.to_vec(),
        };
        let svg = Ranges {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_unit: Unit::Count,
            y_unit: Unit::Nanoseconds,
            ends: ["p50".to_owned(), "p99".to_owned()],
            ranges: vec![
                range("drawn", &[(1.0, [2.0, 3.0]), (10.0, [3.0, 30.0])]),
                range("absent", &[]),
            ],
        }
        .draw()
        .render()
        .into_string();
        assert_eq!(svg.matches("<path class=\"line thin s2\"").count(), 1);
        assert_eq!(svg.matches("<line class=\"range s2\"").count(), 2);
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(!svg.contains("absent") && svg.contains("drawn p99: 10, 30 ns"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}
