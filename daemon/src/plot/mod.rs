//! Plots of measurements as SVG: scaling lines and ranges, points with their Pareto front, stacked
//! bars.
//!
//! A [`Plot`] is one `<svg>` element without outside resources. Colours come from the classes of
//! [`STYLE`], which follow the reader's light or dark theme; [`standalone`] makes a file of plots.
//! Every mark has a `<title>`, so that a tooltip shows its figure.

mod bars;
mod frame;
mod front;
mod lines;
mod points;
mod ranges;
mod scale;
mod tags;
mod unit;

pub use bars::{Bar, Bars};
pub use front::pareto_front;
pub use lines::{Line, Lines};
pub use points::{Group, Point, Points};
pub use ranges::{Range, Ranges};
pub use scale::{Scale, Tick};
pub use unit::Unit;

use maud::{Markup, PreEscaped, Render, html};

use self::frame::WIDTH;

/// Colours and type of all plots. The eight colours are Okabe and Ito's, which differ for readers
/// who do not tell red from green; the lightest of them, yellow, is darkened to show on white.
pub const STYLE: &str = "\
.plot{font:12px system-ui,sans-serif;--ink:#222;--faint:#8884;--grey:#999;--paper:#fff}\
.plot text{fill:var(--ink)}.plot .title{font-size:14px;font-weight:600}\
.plot .grid{stroke:var(--faint);stroke-width:1}.plot .front{fill:none;stroke:var(--ink);stroke-width:1.5;stroke-dasharray:5 3}\
.plot .level{stroke:var(--ink);stroke-width:1.5;stroke-dasharray:2 3}.plot .line{fill:none;stroke-width:2}.plot .line.again{stroke-dasharray:3 3}\
.plot .tag{font-size:11px;paint-order:stroke;stroke:var(--paper);stroke-width:3px}\
.plot .faded{fill:var(--grey)}.plot .range{stroke-width:3;opacity:.45}.plot path.thin{stroke-width:1.2;opacity:.7}.plot .other{stroke:var(--grey);fill:var(--grey)}\
.plot path.o0{stroke-dasharray:6 4}.plot path.o1{stroke-dasharray:2 4}.plot path.o2{stroke-dasharray:9 3 2 3}\
.plot .s0{stroke:#0072b2;fill:#0072b2}.plot .s1{stroke:#d55e00;fill:#d55e00}\
.plot .s2{stroke:#009e73;fill:#009e73}.plot .s3{stroke:#cc79a7;fill:#cc79a7}\
.plot .s4{stroke:#56b4e9;fill:#56b4e9}.plot .s5{stroke:#e69f00;fill:#e69f00}\
.plot .s6{stroke:#a89a00;fill:#a89a00}.plot .s7{stroke:#777;fill:#777}\
.plot circle.beaten{fill:var(--grey);fill-opacity:.4;stroke-opacity:.45}.plot path.line{fill:none!important}.plot circle.hollow{fill:var(--paper)!important;stroke-width:2}\
@media(max-width:600px){.plot{font-size:16px}.plot .title{font-size:18px}.plot .tag{font-size:13px}}\
@media(prefers-color-scheme:dark){.plot{--ink:#ddd;--faint:#fff2;--grey:#777;--paper:#111}}";

/// How many colours [`STYLE`] has; series beyond take them again, their lines dashed.
const COLOURS: usize = 8;
/// Room between the plots of a file, and left of what stands above them.
const GAP: f64 = 24.0;
/// Room for a file's title, and for each line below it.
const HEAD: f64 = 56.0;
const LINE: f64 = 17.0;

/// The class of a series.
fn series_class(series: usize) -> String {
    let again = if series < COLOURS { "" } else { " again" };
    format!("s{}{again}", series % COLOURS)
}

/// A drawn plot. It renders as one `<svg>` element that the page scales.
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    height: f64,
    marks: Markup,
}

impl Plot {
    /// A plot of the common width and this height, in SVG units.
    fn new(title: &str, height: f64, marks: Markup) -> Self {
        Self { title: title.to_owned(), height, marks }
    }
}

impl Render for Plot {
    fn render(&self) -> Markup {
        html! {
            svg.plot xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(self.title)
                viewBox=(format!("0 0 {WIDTH} {}", self.height)) { (self.marks) }
        }
    }
}

/// Plots below each other as the text of an SVG file, below a title and lines that say what is shown.
pub fn standalone(title: &str, lines: &[String], plots: &[Plot]) -> String {
    let head = HEAD + LINE * lines.len() as f64;
    let tops = plots.iter().scan(head, |top, plot| {
        let at = *top;
        *top += plot.height + GAP;
        Some(at)
    });
    let height = head + plots.iter().map(|plot| plot.height + GAP).sum::<f64>();
    let file = html! {
        svg.plot xmlns="http://www.w3.org/2000/svg" width=(WIDTH) height=(height)
            viewBox=(format!("0 0 {WIDTH} {height}")) {
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="var(--paper)" {}
            text.title x=(GAP) y="24" style="font-size:17px" { (title) }
            @for (i, line) in lines.iter().enumerate() {
                text x=(GAP) y=(HEAD - 8.0 + LINE * i as f64) style="font-size:12px" { (line) }
            }
            @for (plot, top) in plots.iter().zip(tops) {
                g transform=(format!("translate(0 {top})")) { (plot.marks) }
            }
        }
    };
    file.into_string() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_carries_its_namespace_and_its_style_inside_the_root() {
        let lines = Lines {
            title: "a < b".to_owned(),
            x_label: "boxes".to_owned(),
            y_label: "time".to_owned(),
            x_unit: Unit::Count,
            y_unit: Unit::Nanoseconds,
            lines: vec![Line { name: "one".to_owned(), points: vec![(10.0, 100.0), (100.0, 1e3)] }],
        };
        let file =
            standalone("all & sundry", &["a line".to_owned()], &[lines.draw(), lines.draw()]);
        assert!(file.starts_with("<svg class=\"plot\" xmlns=\"http://www.w3.org/2000/svg\""));
        assert_eq!(file.matches("<svg").count(), 1, "plots are groups of one element");
        let style = file.find("<style>").expect("a style");
        assert!(style < file.find("<text").expect("a title"));
        assert!(file.contains("a &lt; b") && file.contains("all &amp; sundry"), "text is escaped");
        assert!(file.contains("a line"));
        assert!(file.trim_end().ends_with("</svg>"));
    }
}
