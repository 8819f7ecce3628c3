//! A drawing as SVG: what the terminal shows, for pages.
//!
//! Dots and bars become rectangles, so that they stand in their places in any font; the rest is text, each run of which
//! is stretched to its width.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ratatui::buffer::{Buffer, Cell};
use ratatui::style::{Color, Modifier};

/// A character's width and height, in units of the picture. A dot is half of the one, a quarter of the other.
const WIDTH: usize = 8;
const HEIGHT: usize = 16;
const FONT_SIZE: usize = 13;
const BACKGROUND: &str = "#14161b";
const TEXT: &str = "#d7dae0";
const DIM: &str = "#8b919c";

/// The whole buffer as an SVG document, `label` for those who do not see it.
pub fn svg(buffer: &Buffer, label: &str) -> String {
    let area = buffer.area;
    let [width, height] = [usize::from(area.width) * WIDTH, usize::from(area.height) * HEIGHT];
    let mut rects: BTreeMap<&str, String> = BTreeMap::new();
    let mut texts = String::new();
    for y in 0..area.height {
        let cells: Vec<&Cell> =
            (0..area.width).filter_map(|x| buffer.cell((area.x + x, area.y + y))).collect();
        let top = usize::from(y) * HEIGHT;
        for (style, run, from) in runs(&cells) {
            match style {
                Style::Shape(color) => {
                    let path = rects.entry(color).or_default();
                    for (column, cell) in run.iter().enumerate() {
                        shape(path, symbol(cell), [(from + column) * WIDTH, top]);
                    }
                }
                Style::Text { color, is_bold } => {
                    text(&mut texts, run, color, is_bold, [from * WIDTH, top]);
                }
                Style::Blank => {}
            }
        }
    }
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\">\n\
         <title>{}</title>\n\
         <rect width=\"{width}\" height=\"{height}\" rx=\"6\" fill=\"{BACKGROUND}\"/>\n",
        escaped(label)
    );
    for (color, path) in rects {
        let _ = writeln!(svg, "<path fill=\"{color}\" d=\"{path}\"/>");
    }
    let _ = write!(
        svg,
        "<g font-family=\"ui-monospace,Menlo,Consolas,monospace\" font-size=\"{FONT_SIZE}\">\n{texts}</g>\n</svg>\n"
    );
    svg
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Style {
    Blank,
    Shape(&'static str),
    Text { color: &'static str, is_bold: bool },
}

fn symbol(cell: &Cell) -> char {
    cell.symbol().chars().next().unwrap_or(' ')
}

fn style(cell: &Cell) -> Style {
    let is_dim = cell.modifier.contains(Modifier::DIM);
    let color = if is_dim && cell.fg == Color::Reset { DIM } else { color(cell.fg) };
    match symbol(cell) {
        ' ' | '\u{2800}' => Style::Blank,
        '\u{2801}'..='\u{28ff}' | '█'..='▏' | '─' | '│' | '┌' | '┐' | '└' | '┘' => {
            Style::Shape(color)
        }
        _ => Style::Text { color, is_bold: cell.modifier.contains(Modifier::BOLD) },
    }
}

const fn color(color: Color) -> &'static str {
    match color {
        Color::Blue => "#5b7db8",
        Color::Yellow => "#f0c24b",
        Color::Green => "#6cc26a",
        Color::Red => "#d9695f",
        Color::Gray => "#9aa0aa",
        _ => TEXT,
    }
}

/// Neighbouring cells of one style, and the column of the first. A blank within a text is part of it.
fn runs<'a>(cells: &'a [&'a Cell]) -> Vec<(Style, &'a [&'a Cell], usize)> {
    let mut runs = Vec::new();
    let mut from = 0;
    while from < cells.len() {
        let first = style(cells[from]);
        let is_text = matches!(first, Style::Text { .. });
        let mut end = from + 1;
        let mut next = end;
        while next < cells.len() {
            let this = style(cells[next]);
            if this == first {
                end = next + 1;
            } else if !(is_text && this == Style::Blank) {
                break;
            }
            next += 1;
        }
        runs.push((first, &cells[from..end], from));
        from = end;
    }
    runs
}

fn rect(path: &mut String, [x, y]: [usize; 2], [width, height]: [usize; 2]) {
    let _ = write!(path, "M{x} {y}h{width}v{height}h-{width}z");
}

/// The bits of a braille pattern's dots, row by row.
const BRAILLE: [[u32; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// A character of dots, blocks or lines.
fn shape(path: &mut String, symbol: char, [x, y]: [usize; 2]) {
    let (middle, centre) = (x + WIDTH / 2, y + HEIGHT / 2);
    match symbol {
        '\u{2801}'..='\u{28ff}' => {
            let dots = u32::from(symbol) - 0x2800;
            let dot = [WIDTH / 2, HEIGHT / 4];
            for (row, bits) in (0..).zip(BRAILLE) {
                let top = y + row * dot[1];
                match bits.map(|bit| dots & bit != 0) {
                    [true, true] => rect(path, [x, top], [WIDTH, dot[1]]),
                    [true, false] => rect(path, [x, top], dot),
                    [false, true] => rect(path, [middle, top], dot),
                    [false, false] => {}
                }
            }
        }
        // From the whole block to its left eighth.
        '█'..='▏' => {
            let eighths = (u32::from('▏') - u32::from(symbol) + 1) as usize;
            rect(path, [x, y + 3], [WIDTH * eighths / 8, HEIGHT - 6]);
        }
        '─' => rect(path, [x, centre], [WIDTH, 1]),
        '│' => rect(path, [middle, y], [1, HEIGHT]),
        _ => {
            let right = if ['┌', '└'].contains(&symbol) { middle } else { x };
            let down = if ['┌', '┐'].contains(&symbol) { centre } else { y };
            rect(path, [right, centre], [WIDTH / 2, 1]);
            rect(path, [middle, down], [1, HEIGHT / 2]);
        }
    }
}

fn text(texts: &mut String, run: &[&Cell], color: &str, is_bold: bool, [x, y]: [usize; 2]) {
    let words: String = run.iter().map(|cell| cell.symbol()).collect();
    let (width, baseline) = (run.len() * WIDTH, y + HEIGHT * 3 / 4);
    let weight = if is_bold { " font-weight=\"bold\"" } else { "" };
    let _ = writeln!(
        texts,
        "<text x=\"{x}\" y=\"{baseline}\" textLength=\"{width}\" fill=\"{color}\"{weight} xml:space=\"preserve\">{}</text>",
        escaped(&words)
    );
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;

    #[test]
    fn text_is_escaped_and_stretched_and_shapes_are_rectangles() {
        let mut buffer = Buffer::empty(Rect::new(0, 0, 12, 2));
        buffer.set_string(0, 0, "a<b & c", Style::new().fg(Color::Green));
        buffer.set_string(0, 1, "⣿⠁█▏─", Style::new().fg(Color::Yellow));
        let svg = svg(&buffer, "one & two");
        assert!(
            svg.contains("viewBox=\"0 0 96 32\"") && svg.contains("<title>one &amp; two</title>")
        );
        let text =
            "textLength=\"56\" fill=\"#6cc26a\" xml:space=\"preserve\">a&lt;b &amp; c</text>";
        assert!(svg.contains(text), "{svg}");
        let dots = "M0 16h8v4h-8zM0 20h8v4h-8zM0 24h8v4h-8zM0 28h8v4h-8z";
        let rest = "M8 16h4v4h-4zM16 19h8v10h-8zM24 19h1v10h-1zM32 24h8v1h-8z";
        assert!(svg.contains(&format!("<path fill=\"#f0c24b\" d=\"{dots}{rest}\"/>")), "{svg}");
        assert_eq!(svg.matches("<text").count(), 1);
    }
}
