//! Lines over a logarithmic plane: how something scales.

use maud::html;

use super::frame::{Axis, Frame, coordinate};
use super::scale::Scale;
use super::unit::Unit;
use super::{Plot, series_class};

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Its name in the key.
    pub name: String,
    /// Where it goes, in order.
    pub points: Vec<(f64, f64)>,
}

/// Lines on logarithmic axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Lines {
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
    /// The lines.
    pub lines: Vec<Line>,
}

impl Lines {
    /// The plot.
    pub fn draw(&self) -> Plot {
        self.draw_beside(&[])
    }

    /// The plot, with lines of somebody else beside: grey and dashed.
    pub fn draw_beside(&self, others: &[Line]) -> Plot {
        let own = self.lines.iter().enumerate().map(|(i, line)| (series_class(i), line));
        let others = others.iter().enumerate().map(|(i, line)| (other_class(i), line));
        let lines: Vec<(String, &Line)> = own.chain(others).collect();
        let points = || lines.iter().flat_map(|(_, line)| &line.points);
        let frame = Frame {
            title: &self.title,
            x: Axis {
                label: &self.x_label,
                unit: self.x_unit,
                scale: Scale::log(points().map(|p| p.0)),
            },
            y: Axis {
                label: &self.y_label,
                unit: self.y_unit,
                scale: Scale::log(points().map(|p| p.1)),
            },
            key: lines.iter().map(|(class, line)| (class.clone(), line.name.as_str())).collect(),
        };
        let path = |line: &Line| -> String {
            let steps: Vec<String> = line
                .points
                .iter()
                .map(|&(x, y)| format!("{} {}", coordinate(frame.x(x)), coordinate(frame.y(y))))
                .collect();
            format!("M{}", steps.join("L"))
        };
        frame.around(&html! {
            @for (class, line) in lines.iter().filter(|(_, line)| !line.points.is_empty()) {
                path class=(format!("line {class}")) d=(path(line)) {}
                @for &(x, y) in &line.points {
                    circle class=(class) r="3" cx=(coordinate(frame.x(x))) cy=(coordinate(frame.y(y))) {
                        title { (line.name) ": " (self.x_unit.text(x)) ", " (self.y_unit.text(y)) }
                    }
                }
            }
        })
    }
}

/// How many ways of dashing the style has for lines of others.
const DASHES: usize = 3;

/// The class of a line of somebody else.
fn other_class(line: usize) -> String {
    format!("other o{}", line % DASHES)
}

#[cfg(test)]
mod tests {
    use maud::Render;

    use super::*;

    #[test]
    fn a_line_without_points_stands_in_the_key_and_draws_nothing() {
        let line = |name: &str, points: &[(f64, f64)]| Line {
            name: name.to_owned(),
            points: points.to_vec(),
        };
        let svg = Lines {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_unit: Unit::Count,
            y_unit: Unit::Nanoseconds,
            lines: vec![line("drawn", &[(1.0, 2.0), (10.0, 3.0)]), line("absent", &[])],
        }
        .draw()
        .render()
        .into_string();
        assert_eq!(svg.matches("<path class=\"line s0\"").count(), 1);
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("absent") && svg.contains("drawn: 10, 3 ns"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn lines_of_others_stand_apart() {
        let line =
            |name: &str| Line { name: name.to_owned(), points: vec![(1.0, 1.0), (9.0, 9.0)] };
        let lines = Lines {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_unit: Unit::Count,
            y_unit: Unit::Nanoseconds,
            lines: vec![line("ours")],
        };
        let svg = lines.draw_beside(&[line("theirs")]).render().into_string();
        for class in ["line s0", "line other o0"] {
            assert_eq!(svg.matches(&format!("<path class=\"{class}\"")).count(), 1, "{svg}");
        }
        assert!(svg.contains("theirs: 9, 9 ns"));
    }
}
