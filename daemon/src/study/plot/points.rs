//! Points on a logarithmic plane with their Pareto front: what one axis buys on the other.

use maud::html;

use super::frame::{self, Axis, Frame, coordinate};
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
    /// A third cost, which no axis shows; the same for all points where there is none.
    pub hidden: f64,
    /// What stands beside it if nothing beats it, or where there are few points.
    pub tag: String,
    /// What a pointer that rests on it reads, before the two numbers.
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

/// Points on logarithmic axes. The front of the two axes is drawn through its points; points that only
/// their hidden cost saves are hollow; those that are beaten are grey.
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

/// How a point stands among the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Standing {
    Beaten,
    /// By its hidden cost alone.
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
        // The winners are drawn last, above those they beat.
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
        let is_tagged = |standing| marks.len() <= MOST_TAGS || standing != Standing::Beaten;
        let tagged = marks.iter().filter(|(_, standing)| is_tagged(*standing));
        let tagged = tagged.map(|((_, point), standing)| (*point, *standing));
        frame.around(&html! {
            @if let Some(path) = front_path(&frame, &places, &on_line) {
                path.front d=(path) {}
            }
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
            @for tag in tags(&frame, tagged) {
                text class=(tag.class) x=(coordinate(tag.x)) y=(coordinate(tag.y)) text-anchor=(tag.anchor) {
                    (tag.text)
                }
            }
        })
    }
}

/// A name beside a point.
struct Tag<'a> {
    x: f64,
    y: f64,
    anchor: &'static str,
    class: &'static str,
    text: &'a str,
}

/// Most points of which the beaten ones have names, too.
const MOST_TAGS: usize = 12;

/// Height of a line of names.
const TAG_ROW: f64 = 12.0;
/// Names nearer to each other than this along x are kept apart along y.
const TAG_WIDTH: f64 = 110.0;

/// Names beside points, moved down where they would cover each other.
fn tags<'a>(
    frame: &Frame<'_>,
    points: impl Iterator<Item = (&'a Point, Standing)>,
) -> Vec<Tag<'a>> {
    let mut points: Vec<_> = points.filter(|(point, _)| !point.tag.is_empty()).collect();
    // From the top: the largest y first.
    points.sort_by(|a, b| b.0.y.total_cmp(&a.0.y));
    let mut tags: Vec<Tag<'a>> = Vec::new();
    for (point, standing) in points {
        let class = if standing == Standing::Beaten { "tag faded" } else { "tag" };
        let (x, mut y) = (frame.x(point.x), frame.y(point.y) + 4.0);
        let is_right = x > frame::WIDTH * 0.72;
        let (x, anchor) = if is_right { (x - 9.0, "end") } else { (x + 9.0, "start") };
        for tag in &tags {
            if (tag.x - x).abs() < TAG_WIDTH && (tag.y - y).abs() < TAG_ROW {
                y = tag.y + TAG_ROW;
            }
        }
        tags.push(Tag { x, y, anchor, class, text: &point.tag });
    }
    tags
}

/// The front as a staircase: between two of its points nothing better is known than the left one.
fn front_path(frame: &Frame<'_>, places: &[[f64; 2]], on_front: &[bool]) -> Option<String> {
    let mut front: Vec<[f64; 2]> =
        places.iter().zip(on_front).filter(|(_, wins)| **wins).map(|(p, _)| *p).collect();
    front.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let (first, rest) = front.split_first()?;
    let place = |&[x, y]: &[f64; 2]| [coordinate(frame.x(x)), coordinate(frame.y(y))];
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
    fn names_do_not_cover_each_other() {
        let frame = Frame {
            title: "",
            x: Axis { label: "", unit: Unit::Ratio, scale: Scale::log([0.0, 1.0]) },
            y: Axis { label: "", unit: Unit::Ratio, scale: Scale::log([1.0, 10.0]) },
            key: Vec::new(),
        };
        let points = [point(0.0, 2.0, 0.0), point(0.0, 2.0, 0.0), point(0.0, 2.01, 0.0)];
        let tags = tags(&frame, points.iter().map(|point| (point, Standing::OnFront)));
        assert!(tags.windows(2).all(|pair| pair[1].y - pair[0].y >= TAG_ROW - 1e-9));
    }
}
