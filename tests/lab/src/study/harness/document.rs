//! Documents: the parts of a report, written once, as Markdown and as an HTML page that loads nothing.

use std::fmt::Write as _;

use super::table::Table;

/// A part of a document. Texts may have `code` and **words that stand out**.
#[derive(Clone, Debug)]
pub enum Part {
    /// A heading: its level, from 1 on, and its text.
    Heading(u8, String),
    Text(String),
    List(Vec<String>),
    Table(Table),
    /// Plots side by side, in HTML alone.
    Plots(Vec<String>),
}

impl Part {
    pub fn heading(level: u8, text: impl Into<String>) -> Self {
        Self::Heading(level, text.into())
    }

    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// A heading, a note, and a table; nothing without rows.
    pub fn section(title: &str, note: &str, table: Table) -> Vec<Self> {
        if table.rows.is_empty() {
            return Vec::new();
        }
        vec![Self::heading(2, title), Self::text(note), Self::Table(table)]
    }
}

pub fn markdown(parts: &[Part]) -> String {
    let text = |part: &Part| match part {
        Part::Heading(level, text) => format!("{} {text}\n", "#".repeat(usize::from(*level))),
        Part::Text(text) if !text.is_empty() => format!("{text}\n"),
        Part::List(lines) if !lines.is_empty() => format!("- {}\n", lines.join("\n- ")),
        Part::Table(table) => table.markdown(),
        _ => String::new(),
    };
    let parts: Vec<String> = parts.iter().map(text).filter(|text| !text.is_empty()).collect();
    parts.join("\n")
}

const STYLE: &str = "\
:root{color-scheme:light dark}\
body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2rem auto;padding:0 1rem}\
h1{margin-bottom:.2rem}h2{margin-top:2.5rem}h3{margin:1.6rem 0 .3rem}code{font-size:.92em}\
p{max-width:60em;margin:.4rem 0}li{margin:.2rem 0}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(540px,100%),1fr));gap:1.5rem}\
.plots svg{width:100%;height:auto}.scroll{overflow-x:auto}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.4rem 0 1rem;font-size:13px}\
td,th{padding:.15rem .6rem;text-align:right;border-bottom:1px solid #8884;vertical-align:top}\
td.name,th.name{text-align:left}tr:hover{background:#8882}";

/// Colours of words that stand out, by how they begin; others are bold.
const COLOURS: [(&str, &str); 4] = [
    ("holds", "#009e73"),
    ("No pair was missed", "#009e73"),
    ("not measured", "#8a8a8a"),
    ("", "#d55e00"),
];

/// The parts as a page, whose title is that of its first heading.
pub fn html(parts: &[Part]) -> String {
    let title = parts.iter().find_map(|part| match part {
        Part::Heading(_, text) => Some(escaped(text)),
        _ => None,
    });
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>Pairmask: {}</title><style>{STYLE}</style></head><body>\n",
        title.unwrap_or_default()
    );
    // Writing to a String cannot fail.
    for part in parts {
        let _ = match part {
            Part::Heading(level, text) => writeln!(page, "<h{level}>{}</h{level}>", escaped(text)),
            Part::Text(text) => writeln!(page, "<p>{}</p>", marked(text)),
            Part::List(lines) => {
                let lines = lines.iter().map(|line| format!("<li>{}</li>\n", marked(line)));
                writeln!(page, "<ul>\n{}</ul>", lines.collect::<String>())
            }
            Part::Table(table) => {
                let mut lines = String::new();
                for (number, line) in table.lines().iter().enumerate() {
                    let filter_data = if number == 0 { "th" } else { "td" };
                    lines += "<tr>";
                    for (at, cell) in line.iter().enumerate() {
                        let class = if table.is_left(at) { " class=\"name\"" } else { "" };
                        let _ =
                            write!(lines, "<{filter_data}{class}>{}</{filter_data}>", marked(cell));
                    }
                    lines += "</tr>\n";
                }
                writeln!(page, "<div class=\"scroll\"><table>\n{lines}</table></div>")
            }
            Part::Plots(plots) => writeln!(page, "<div class=\"plots\">{}</div>", plots.concat()),
        };
    }
    page + "</body></html>\n"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn marked(text: &str) -> String {
    let mut out = String::new();
    for (i, part) in escaped(text).split("**").enumerate() {
        if i % 2 == 1 {
            let colour = COLOURS.iter().find(|(start, _)| part.starts_with(start));
            let colour = colour.map_or("", |(_, colour)| colour);
            let _ = write!(out, "<strong style=\"color:{colour}\">{part}</strong>");
            continue;
        }
        for (j, part) in part.split('`').enumerate() {
            let [open, close] = if j % 2 == 1 { ["<code>", "</code>"] } else { [""; 2] };
            out.extend([open, part, close]);
        }
    }
    out
}
