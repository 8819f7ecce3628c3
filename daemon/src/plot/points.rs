//! Points on logarithmic axes with their Pareto front: the cost on one axis against that on the
//! other.

use maud::html;

use super::frame::{Axis, Frame, coordinate};
use super::front::pareto_front;
use super::scale::Scale;
use super::tags::{self, Area, Place, Wish};
use super::unit::Unit;
use super::{Plot, series_class};

/// One measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The smaller, the better.
    pub x: f64,
    /// The smaller, the better.
    pub y: f64,
    /// A third cost, which no axis shows; the same for all points where there is none.
    pub hidden: f64,
    /// Name beside the point, shown if no point beats it, or where there are few points.
    pub tag: String,
    /// Text of the point's tooltip, before the two numbers.
    pub label: String,
}

/// Points of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Its name in the key.
    pub name: String,
    /// Its colour: groups of the same number look the same in every plot of a page.
    pub series: usize,
    /// Its points.
    pub points: Vec<Point>,
}

/// Points on logarithmic axes. The front of the two axes is drawn through its points; points that are
/// on the front only by their hidden cost are hollow; beaten points are grey.
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

/// The standing of a point among the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Standing {
    Beaten,
    /// On the front by its hidden cost alone.
    Saved,
    OnFront,
}

impl Points {
    /// The plot.
    pub fn draw(&self) -> Plot {
        let all: Vec<(usize, &Point)> = self
            .groups
            .iter()
            .flat_map(|group| group.points.iter().map(move |point| (group.series, point)))
            .collect();
        let places: Vec<[f64; 2]> = all.iter().map(|(_, p)| [p.x, p.y]).collect();
        let costs: Vec<[f64; 3]> = all.iter().map(|(_, p)| [p.x, p.y, p.hidden]).collect();
        let on_line = pareto_front(&places);
        let standings =
            pareto_front(&costs).into_iter().zip(&on_line).map(|standing| match standing {
                (false, _) => Standing::Beaten,
                (true, false) => Standing::Saved,
                (true, true) => Standing::OnFront,
            });
        // Points on the front are drawn last, above the points that they beat.
        let mut marks: Vec<_> = all.iter().copied().zip(standings).collect();
        marks.sort_by_key(|(_, standing)| *standing);
        let frame = Frame {
            title: &self.title,
            x: Axis {
                label: &self.x_label,
                unit: self.x_unit,
                scale: Scale::log(places.iter().map(|p| p[0])),
            },
            y: Axis {
                label: &self.y_label,
                unit: self.y_unit,
                scale: Scale::log(places.iter().map(|p| p[1])),
            },
            key: self
                .groups
                .iter()
                .map(|group| (series_class(group.series), &*group.name))
                .collect(),
        };
        let front = staircase(&frame, &places, &on_line);
        frame.around(&html! {
            @if !front.is_empty() { path.front d=(path(&front)) {} }
            @for ((series, point), standing) in &marks {
                @let class = match standing {
                    Standing::Beaten => format!("beaten {}", series_class(*series)),
                    Standing::Saved => format!("hollow {}", series_class(*series)),
                    Standing::OnFront => series_class(*series),
                };
                circle class=(class) r=(if *standing == Standing::Beaten { "4" } else { "5" })
                    cx=(coordinate(frame.x(point.x))) cy=(coordinate(frame.y(point.y))) {
                    title {
                        (point.label) ": " (self.x_unit.text(point.x)) ", " (self.y_unit.text(point.y))
                    }
                }
            }
            @for Tag { place, class, text } in tags(&frame, &marks, &front) {
                text class=(class) x=(coordinate(place.x)) y=(coordinate(place.y))
                    text-anchor=(place.anchor) { (text) }
            }
        })
    }
}

/// A name beside a point.
struct Tag<'a> {
    place: Place,
    class: &'static str,
    text: &'a str,
}

/// Most points of a plot in which beaten points have names too.
const MOST_TAGS: usize = 12;

/// Names beside those points that have one and room for it, the best first.
fn tags<'a>(
    frame: &Frame<'_>,
    marks: &[((usize, &'a Point), Standing)],
    front: &[[f64; 2]],
) -> Vec<Tag<'a>> {
    let at = |point: &Point| [frame.x(point.x), frame.y(point.y)];
    let is_tagged = |standing| marks.len() <= MOST_TAGS || standing != Standing::Beaten;
    let mut tagged: Vec<_> = marks
        .iter()
        .filter(|((_, point), standing)| is_tagged(*standing) && !point.tag.is_empty())
        .map(|((_, point), standing)| (*point, *standing))
        .collect();
    tagged.sort_by_key(|(_, standing)| std::cmp::Reverse(*standing));
    let options: Vec<Wish<'_>> =
        tagged.iter().map(|(point, _)| Wish { at: at(point), text: &point.tag }).collect();
    let points: Vec<Area> = marks.iter().map(|((_, point), _)| Area::of_point(at(point))).collect();
    let lines: Vec<Area> = front.windows(2).map(|ends| Area::of_line(ends[0], ends[1])).collect();
    tags::place(&options, &points, &lines)
        .into_iter()
        .zip(tagged)
        .filter_map(|(place, (point, standing))| {
            let class = if standing == Standing::Beaten { "tag faded" } else { "tag" };
            Some(Tag { place: place?, class, text: &point.tag })
        })
        .collect()
}

/// The corners of the front as a staircase, in SVG units: between two of its points, the left one is
/// the best known.
fn staircase(frame: &Frame<'_>, places: &[[f64; 2]], on_front: &[bool]) -> Vec<[f64; 2]> {
    let mut front: Vec<[f64; 2]> =
        places.iter().zip(on_front).filter(|(_, wins)| **wins).map(|(p, _)| *p).collect();
    front.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let mut corners: Vec<[f64; 2]> = Vec::new();
    for [x, y] in front {
        let (x, y) = (frame.x(x), frame.y(y));
        corners.extend(corners.last().map(|[_, above]| [x, *above]));
        corners.push([x, y]);
    }
    corners
}

/// Corners as a path.
fn path(corners: &[[f64; 2]]) -> String {
    let steps: Vec<String> =
        corners.iter().map(|[x, y]| format!("{} {}", coordinate(*x), coordinate(*y))).collect();
    format!("M{}", steps.join("L"))
}

#[cfg(test)]
mod tests {
    use maud::Render;

    use super::*;

    fn point(x: f64, y: f64, hidden: f64) -> Point {
        Point { x, y, hidden, tag: format!("tag {x}"), label: format!("{x}/{y}") }
    }

    fn draw(groups: Vec<Group>) -> String {
        let points = Points {
            title: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_unit: Unit::Ratio,
            y_unit: Unit::Nanoseconds,
            groups,
        };
        points.draw().render().into_string()
    }

    fn group(series: usize, points: Vec<Point>) -> Group {
        Group { name: format!("group {series}"), series, points }
    }

    #[test]
    fn beaten_points_are_grey_and_the_front_passes_the_others() {
        let svg = draw(vec![
            group(0, vec![point(0.0, 100.0, 9.0), point(0.1, 200.0, 9.0), point(0.1, 300.0, 8.0)]),
            group(4, vec![point(0.2, 50.0, 9.0)]),
        ]);
        assert_eq!(svg.matches("class=\"beaten s0\"").count(), 1, "{svg}");
        assert_eq!(svg.matches("class=\"hollow s0\"").count(), 1, "saved by what no axis shows");
        assert_eq!(svg.matches("class=\"front\"").count(), 1);
        assert_eq!(svg.matches("class=\"s4\"").count(), 2, "the point and its square in the key");
        assert_eq!(svg.matches("class=\"tag\"").count(), 3);
        assert_eq!(svg.matches("class=\"tag faded\"").count(), 1);
        let crowd = (0..20).map(|i| point(f64::from(i), f64::from(i) + 1.0, 0.0)).collect();
        let crowd = draw(vec![group(0, crowd)]);
        assert_eq!(crowd.matches("class=\"tag").count(), 1, "no name beside beaten ones of many");
        assert!(svg.contains("0.2/50: 0.2, 50 ns"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn points_in_one_place_have_names_in_different_ones() {
        let frame = Frame {
            title: "",
            x: Axis { label: "", unit: Unit::Ratio, scale: Scale::log([0.0, 1.0]) },
            y: Axis { label: "", unit: Unit::Ratio, scale: Scale::log([1.0, 10.0]) },
            key: Vec::new(),
        };
        let points = [point(0.0, 2.0, 0.0), point(0.0, 2.0, 0.0), point(0.0, 2.01, 0.0)];
        let marks: Vec<_> = points.iter().map(|point| ((0, point), Standing::OnFront)).collect();
        let tags = tags(&frame, &marks, &[]);
        assert_eq!(tags.len(), 3);
        for (i, tag) in tags.iter().enumerate() {
            let others = &tags[..i];
            assert!(others.iter().all(|other| other.place != tag.place));
        }
    }
}
