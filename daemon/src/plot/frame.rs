//! The frame of a plot: title, axes, grid, key.

use maud::{Markup, html};

use super::Plot;
use super::scale::{Scale, Tick};
use super::tags::Area;
use super::unit::Unit;

/// Width and height of a plot, in SVG units; the page scales it.
pub(super) const WIDTH: f64 = 640.0;
pub(super) const HEIGHT: f64 = 400.0;
/// Room for the labels on each side.
const LEFT: f64 = 84.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 54.0;
/// Height of a row of the key.
const KEY_ROW: f64 = 20.0;
/// Approximate width of a character at the font size of phones. A layout by it has no collisions at
/// the smaller font size of other screens either.
pub(super) const CHAR_WIDTH: f64 = 8.8;
/// Where the x axis ends.
pub(super) const END: f64 = WIDTH - RIGHT;
/// From the end of a label to the start of the next one, at least.
const LABEL_GAP: f64 = 6.0;
/// The area of the marks and the names beside them.
pub(super) const AREA: Area =
    Area { left: LEFT, top: TOP - 4.0, right: WIDTH - 4.0, bottom: HEIGHT - BOTTOM };

/// One axis.
pub(super) struct Axis<'a> {
    pub(super) label: &'a str,
    pub(super) unit: Unit,
    pub(super) scale: Scale,
}

/// Both axes and the key.
pub(super) struct Frame<'a> {
    pub(super) title: &'a str,
    pub(super) x: Axis<'a>,
    pub(super) y: Axis<'a>,
    /// Classes and names of the series.
    pub(super) key: Vec<(String, &'a str)>,
}

impl Frame<'_> {
    pub(super) fn x(&self, value: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * self.x.scale.place(value)
    }

    pub(super) fn y(&self, value: f64) -> f64 {
        HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * self.y.scale.place(value)
    }

    /// The whole plot around its marks.
    pub(super) fn around(&self, marks: &Markup) -> Plot {
        let height = HEIGHT + KEY_ROW * self.key_rows() as f64;
        let right = WIDTH - RIGHT;
        let bottom = HEIGHT - BOTTOM;
        let middle = f64::midpoint(LEFT, right);
        let half_way = f64::midpoint(TOP, bottom);
        let marks = html! {
                text.title x=(LEFT) y="18" { (self.title) }
                @for (tick, is_labelled) in with_room(self.x.scale.ticks(self.x.unit)) {
                    @let x = coordinate(LEFT + (right - LEFT) * tick.at);
                    line.grid x1=(x) x2=(x) y1=(TOP) y2=(bottom) {}
                    @if is_labelled {
                        text x=(x) y=(bottom + 16.0) text-anchor="middle" { (tick.label) }
                    }
                }
                @for tick in self.y.scale.ticks(self.y.unit) {
                    @let y = bottom - (bottom - TOP) * tick.at;
                    line.grid x1=(LEFT) x2=(right) y1=(coordinate(y)) y2=(coordinate(y)) {}
                    text x=(LEFT - 6.0) y=(coordinate(y + 4.0)) text-anchor="end" { (tick.label) }
                }
                text x=(middle) y=(HEIGHT - 18.0) text-anchor="middle" { (self.x.label) }
                text x="14" y=(half_way) text-anchor="middle"
                    transform=(format!("rotate(-90 14 {half_way})")) { (self.y.label) }
                (marks)
                (self.key())
        };
        Plot::new(self.title, height, marks)
    }

    fn key_rows(&self) -> usize {
        self.key.len().div_ceil(self.key_columns())
    }

    /// As many as the longest name leaves room for.
    fn key_columns(&self) -> usize {
        let longest = self.key.iter().map(|(_, name)| name.chars().count()).max().unwrap_or(0);
        let column = KEY_SQUARE + CHAR_WIDTH * longest as f64 + LABEL_GAP;
        (((WIDTH - LEFT) / column) as usize).clamp(1, KEY_COLUMNS)
    }

    fn key(&self) -> Markup {
        let columns = self.key_columns();
        let width = (WIDTH - LEFT) / columns as f64;
        html! {
            @for (i, (class, name)) in self.key.iter().enumerate() {
                @let x = LEFT + width * (i % columns) as f64;
                @let y = HEIGHT + KEY_ROW * (i / columns) as f64;
                rect class=(class) x=(coordinate(x)) y=(coordinate(y - 9.0)) width="10" height="10" {}
                text x=(coordinate(x + KEY_SQUARE)) y=(coordinate(y)) { (name) }
            }
        }
    }
}

/// Most names of the key in a row.
const KEY_COLUMNS: usize = 3;
/// From the square of a name to the name.
const KEY_SQUARE: f64 = 15.0;

/// Marks of the x axis, each with whether its label has room beside the one before.
fn with_room(ticks: Vec<Tick>) -> Vec<(Tick, bool)> {
    let mut end = f64::NEG_INFINITY;
    let judge = |tick: Tick| {
        let half = CHAR_WIDTH * tick.label.chars().count() as f64 / 2.0;
        let middle = (WIDTH - LEFT - RIGHT) * tick.at;
        let is_labelled = middle - half >= end + LABEL_GAP;
        if is_labelled {
            end = middle + half;
        }
        (tick, is_labelled)
    };
    ticks.into_iter().map(judge).collect()
}

/// A coordinate as text: a tenth of a unit is finer than a pixel, and more digits are only bytes.
pub(super) fn coordinate(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map(str::to_owned).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_that_would_collide_are_left_out() {
        let tick = |at, label: &str| Tick { at, label: label.to_owned() };
        let ticks = vec![tick(0.0, "0"), tick(0.05, "0.001"), tick(0.2, "0.002"), tick(1.0, "1")];
        let labelled: Vec<bool> = with_room(ticks).iter().map(|(_, has_room)| *has_room).collect();
        assert_eq!(labelled, [true, false, true, true]);
    }

    #[test]
    fn the_key_has_as_many_columns_as_its_names_leave_room_for() {
        let axis = || Axis { label: "", unit: Unit::Ratio, scale: Scale::log([1.0]) };
        let columns = |name: &str| {
            let key = vec![(String::new(), name)];
            Frame { title: "", x: axis(), y: axis(), key }.key_columns()
        };
        assert_eq!((columns("q16"), columns("spheres=circumscribed")), (3, 2));
        assert_eq!(columns("a name that is far too long for any place in a key of several"), 1);
    }
}
