//! Points on a logarithmic plane with their Pareto front: what one axis buys on the other.

use maud::html;

use super::frame::{Axis, Frame, coordinate};
use super::front::pareto_front;
use super::scale::Scale;
use super::unit::Unit;
use super::{Plot, series_class};

/// One measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The smaller, the better.
    pub x: f64,
    /// The smaller, the better.
    pub y: f64,
    /// What a pointer that rests on it reads, before the two numbers.
    pub label: String,
}

/// Points of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Its name in the key.
    pub name: String,
    /// Its points.
    pub points: Vec<Point>,
}

/// Points on logarithmic axes, dominated ones greyed, the front drawn through the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
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
    /// The points.
    pub groups: Vec<Group>,
}

impl Points {
    /// The plot.
    pub fn draw(&self) -> Plot {
        let all: Vec<(usize, &Point)> = self
            .groups
            .iter()
            .enumerate()
            .flat_map(|(series, group)| group.points.iter().map(move |point| (series, point)))
            .collect();
        let places: Vec<(f64, f64)> = all.iter().map(|(_, p)| (p.x, p.y)).collect();
        let on_front = pareto_front(&places);
        let frame = Frame {
            title: &self.title,
            x: Axis {
                label: &self.x_label,
                unit: self.x_unit,
                scale: Scale::log(places.iter().map(|p| p.0)),
            },
            y: Axis {
                label: &self.y_label,
                unit: self.y_unit,
                scale: Scale::log(places.iter().map(|p| p.1)),
            },
            key: self.groups.iter().map(|group| group.name.as_str()).collect(),
        };
        // The winners are drawn last, above those they beat.
        let mut marks: Vec<_> = all.iter().zip(&on_front).collect();
        marks.sort_by_key(|(_, wins)| **wins);
        frame.around(&html! {
            @if let Some(path) = front_path(&frame, &places, &on_front) {
                path.front d=(path) {}
            }
            @for ((series, point), wins) in marks {
                @let class = if *wins { series_class(*series) } else { "beaten".to_owned() };
                circle class=(class) r=(if *wins { "5" } else { "4" })
                    cx=(coordinate(frame.x(point.x))) cy=(coordinate(frame.y(point.y))) {
                    title {
                        (point.label) ": " (self.x_unit.text(point.x)) ", " (self.y_unit.text(point.y))
                    }
                }
            }
        })
    }
}

/// The front as a staircase: between two of its points nothing better is known than the left one.
fn front_path(frame: &Frame<'_>, places: &[(f64, f64)], on_front: &[bool]) -> Option<String> {
    let mut front: Vec<(f64, f64)> =
        places.iter().zip(on_front).filter(|(_, wins)| **wins).map(|(p, _)| *p).collect();
    front.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let (first, rest) = front.split_first()?;
    let place = |&(x, y): &(f64, f64)| [coordinate(frame.x(x)), coordinate(frame.y(y))];
    let start = format!("M{}", place(first).join(" "));
    let steps = rest.iter().map(|p| {
        let [x, y] = place(p);
        format!("H{x}V{y}")
    });
    Some(std::iter::once(start).chain(steps).collect())
}

#[cfg(test)]
mod tests {
    use maud::Render;

    use super::*;

    #[test]
    fn beaten_points_are_grey_and_the_front_passes_the_others() {
        let point = |x, y| Point { x, y, label: format!("{x}/{y}") };
        let svg = Points {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_unit: Unit::Ratio,
            y_unit: Unit::Nanoseconds,
            groups: vec![
                Group { name: "a".to_owned(), points: vec![point(0.0, 100.0), point(0.1, 200.0)] },
                Group { name: "b".to_owned(), points: vec![point(0.2, 50.0)] },
            ],
        }
        .draw()
        .render()
        .into_string();
        assert_eq!(svg.matches("class=\"beaten\"").count(), 1, "{svg}");
        assert_eq!(svg.matches("class=\"front\"").count(), 1);
        assert!(svg.contains("0.2/50: 0.2, 50 ns"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}
