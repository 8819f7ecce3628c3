//! The frame of a plot: title, axes, grid, key.

use maud::{Markup, html};

use super::Plot;
use super::scale::Scale;
use super::unit::Unit;

/// Width and height of a plot, in SVG units; the page scales it.
pub(super) const WIDTH: f64 = 640.0;
pub(super) const HEIGHT: f64 = 400.0;
/// Room for the labels on each side.
const LEFT: f64 = 70.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 54.0;
/// Height of a row of the key.
const KEY_ROW: f64 = 16.0;

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
                @for tick in self.x.scale.ticks(self.x.unit) {
                    @let x = coordinate(LEFT + (right - LEFT) * tick.at);
                    line.grid x1=(x) x2=(x) y1=(TOP) y2=(bottom) {}
                    text x=(x) y=(bottom + 16.0) text-anchor="middle" { (tick.label) }
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
        self.key.len().div_ceil(KEY_COLUMNS)
    }

    fn key(&self) -> Markup {
        let width = (WIDTH - LEFT) / KEY_COLUMNS as f64;
        html! {
            @for (i, (class, name)) in self.key.iter().enumerate() {
                @let x = LEFT + width * (i % KEY_COLUMNS) as f64;
                @let y = HEIGHT + KEY_ROW * (i / KEY_COLUMNS) as f64;
                rect class=(class) x=(coordinate(x)) y=(coordinate(y - 9.0)) width="10" height="10" {}
                text x=(coordinate(x + 15.0)) y=(coordinate(y)) { (name) }
            }
        }
    }
}

/// Names of the key in a row.
const KEY_COLUMNS: usize = 3;

/// A coordinate as text: a tenth of a unit is finer than a pixel, and more digits are only bytes.
pub(super) fn coordinate(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map(str::to_owned).unwrap_or(text)
}
