//! Lines on logarithmic axes, for plots of scaling.

use maud::html;

use super::frame::{AREA, Axis, END, Frame, coordinate};
use super::scale::Scale;
use super::unit::Unit;
use super::{Plot, series_class};

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Its name in the key.
    pub name: String,
    /// Its points, in order.
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

    /// The plot, with other authors' lines for comparison: grey and dashed.
    pub fn draw_beside(&self, others: &[Line]) -> Plot {
        self.draw_all(others, None)
    }

    /// The plot, with a horizontal line at `level`, which separates good from bad, and its name.
    pub fn draw_around(&self, level: f64, name: &str) -> Plot {
        self.draw_all(&[], Some((level, name)))
    }

    fn draw_all(&self, others: &[Line], level: Option<(f64, &str)>) -> Plot {
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
                scale: Scale::log(points().map(|p| p.1).chain(level.map(|(at, _)| at))),
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
            @if let Some((at, name)) = level {
                @let y = frame.y(at);
                // Above the line, but not in the title.
                @let name_y = if y - TAG_ROOM < AREA.top { y + TAG_ROOM } else { y - TAG_GAP };
                line.level x1=(coordinate(AREA.left)) x2=(coordinate(END)) y1=(coordinate(y)) y2=(coordinate(y)) {}
                text.tag x=(coordinate(END - 4.0)) y=(coordinate(name_y)) text-anchor="end" { (name) }
            }
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

/// Between a level and its name above it, px.
const TAG_GAP: f64 = 5.0;
/// What a level's name takes with its gap, px: a line of text.
const TAG_ROOM: f64 = 14.0;
/// Number of dash patterns that the style has for other authors' lines.
const DASHES: usize = 3;

/// The class of another author's line.
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
    fn a_level_has_its_name_and_is_within_the_plot() {
        let line = Line { name: "ours".to_owned(), points: vec![(1.0, 0.2), (9.0, 0.4)] };
        let lines = Lines {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_unit: Unit::Count,
            y_unit: Unit::Ratio,
            lines: vec![line],
        };
        let svg = lines.draw_around(1.0, "as fast").render().into_string();
        assert!(svg.contains("as fast") && svg.matches("class=\"level\"").count() == 1, "{svg}");
        assert!(!lines.draw().render().into_string().contains("class=\"level\""));
        // Near the top of the plot the name stands below its line, not in the title.
        let below = |level: f64| {
            let svg = lines.draw_around(level, "as fast").render().into_string();
            let number = |key: &str, after: &str| {
                let text = &svg[svg.find(after).expect("a mark")..];
                let from = text.find(key).expect("a place") + key.len();
                let digits = text[from..].split('"').next().expect("a number");
                digits.parse::<f64>().expect("a number")
            };
            number(" y=\"", "class=\"tag\"") > number(" y1=\"", "class=\"level\"")
        };
        assert!(below(1.0) && !below(0.3));
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
