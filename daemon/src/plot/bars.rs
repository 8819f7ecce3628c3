//! Stacked bars: a total by its parts.

use maud::html;

use super::frame::{WIDTH, coordinate};
use super::unit::Unit;
use super::{Plot, series_class};

/// Room for the names of the bars.
const LEFT: f64 = 240.0;
/// Room for the sums.
const RIGHT: f64 = 70.0;
const TOP: f64 = 30.0;
const ROW: f64 = 24.0;
const BAR: f64 = 16.0;

/// One bar.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// Its name.
    pub name: String,
    /// Its parts, in the order of [`Bars::parts`].
    pub values: Vec<f64>,
}

/// Horizontal bars, each of the same parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Bars {
    /// Title.
    pub title: String,
    /// Names of the parts.
    pub parts: Vec<String>,
    /// How values are written.
    pub unit: Unit,
    /// The bars, from the top.
    pub bars: Vec<Bar>,
}

impl Bars {
    /// The plot.
    pub fn draw(&self) -> Plot {
        let sum = |bar: &Bar| bar.values.iter().sum::<f64>();
        let longest = self.bars.iter().map(sum).fold(f64::MIN_POSITIVE, f64::max);
        let width = |value: f64| (WIDTH - LEFT - RIGHT) * value / longest;
        let key_y = TOP + ROW * self.bars.len() as f64 + 14.0;
        let key_step = (WIDTH - 20.0) / self.parts.len().max(1) as f64;
        let marks = html! {
                text.title x="10" y="18" { (self.title) }
                @for (row, bar) in self.bars.iter().enumerate() {
                    @let y = TOP + ROW * row as f64;
                    text x=(LEFT - 8.0) y=(y + 13.0) text-anchor="end" { (bar.name) }
                    @let starts = bar.values.iter().scan(0.0, |sum, v| { let at = *sum; *sum += v; Some(at) });
                    @for (part, (value, start)) in bar.values.iter().zip(starts).enumerate() {
                        @if *value > 0.0 {
                            rect class=(series_class(part)) x=(coordinate(LEFT + width(start))) y=(y)
                                width=(coordinate(width(*value))) height=(BAR) {
                                title { (bar.name) ", " (self.parts.get(part).map_or("", String::as_str)) ": " (self.unit.text(*value)) }
                            }
                        }
                    }
                    text x=(coordinate(LEFT + width(sum(bar)) + 6.0)) y=(y + 13.0) { (self.unit.text(sum(bar))) }
                }
                @for (part, name) in self.parts.iter().enumerate() {
                    @let x = 10.0 + key_step * part as f64;
                    rect class=(series_class(part)) x=(coordinate(x)) y=(key_y - 9.0) width="10" height="10" {}
                    text x=(coordinate(x + 15.0)) y=(key_y) { (name) }
                }
        };
        Plot::new(&self.title, key_y + 12.0, marks)
    }
}

#[cfg(test)]
mod tests {
    use maud::Render;

    use super::*;

    #[test]
    fn the_longest_bar_fills_the_room_and_parts_that_took_no_time_are_left_out() {
        let bar =
            |name: &str, values: &[f64]| Bar { name: name.to_owned(), values: values.to_vec() };
        let svg = Bars {
            title: String::new(),
            parts: vec!["ingest".to_owned(), "execute".to_owned()],
            unit: Unit::Nanoseconds,
            bars: vec![bar("long", &[300.0, 100.0]), bar("short", &[0.0, 40.0])],
        }
        .draw()
        .render()
        .into_string();
        assert_eq!(svg.matches("<rect").count(), 3 + 2, "three parts and two of the key");
        assert!(svg.contains("width=\"247.5\""), "300 of 400 over the 330 units: {svg}");
        assert!(svg.contains("short, execute: 40 ns"));
    }
}
