//! Tables: cells under a head, as Markdown, CSV and HTML. Rows are what JSON has of them: a column a field, named as
//! the field is, so that every form of a result has the same words.

use std::fmt::{self, Display};

use serde::Serialize;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;

/// Cells under a head.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Names of the columns.
    pub head: Vec<String>,
    /// Cells, a row each.
    pub rows: Vec<Vec<Value>>,
}

/// The fields of a row in the order in which it writes them.
struct Fields(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Fields {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Fields;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Fields, A::Error> {
                let mut fields = Vec::new();
                while let Some(field) = map.next_entry()? {
                    fields.push(field);
                }
                Ok(Fields(fields))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

impl Table {
    /// A table with a column for every field of the rows, those of inner objects and lists with the outer names
    /// before theirs. A row that lacks a field of others has an empty cell there.
    pub fn of<R: Serialize>(rows: &[R]) -> Self {
        let mut table = Self::default();
        for row in rows {
            // Rows are objects that have a JSON form: reports are printed as such.
            let fields = serde_json::to_string(row).and_then(|text| serde_json::from_str(&text));
            let Fields(fields) = fields.unwrap_or(Fields(Vec::new()));
            let mut cells = vec![Value::Null; table.head.len()];
            for (name, value) in fields {
                table.add(&mut cells, name, value);
            }
            table.rows.push(cells);
        }
        for row in &mut table.rows {
            row.resize(table.head.len(), Value::Null);
        }
        table
    }

    fn add(&mut self, cells: &mut Vec<Value>, name: String, value: Value) {
        match value {
            Value::Object(fields) => {
                for (inner, value) in fields {
                    self.add(cells, format!("{name}.{inner}"), value);
                }
            }
            Value::Array(values) => {
                for (i, value) in values.into_iter().enumerate() {
                    self.add(cells, format!("{name}.{i}"), value);
                }
            }
            value => {
                let at = self.head.iter().position(|known| *known == name).unwrap_or_else(|| {
                    self.head.push(name);
                    self.head.len() - 1
                });
                cells.resize(self.head.len(), Value::Null);
                cells[at] = value;
            }
        }
    }

    /// A table of texts.
    pub fn of_texts<const N: usize>(
        head: [&str; N],
        rows: impl IntoIterator<Item = [String; N]>,
    ) -> Self {
        let rows = rows.into_iter().map(|row| row.map(Value::from).to_vec());
        Self { head: head.map(str::to_owned).to_vec(), rows: rows.collect() }
    }

    /// A table with a line for each of `lines` and a column for each size. Lines without a cell are left out.
    pub fn by_size<L: Display + Copy, S: Display + Copy>(
        name: &str,
        lines: impl Iterator<Item = L>,
        sizes: &[S],
        cell: impl Fn(L, S) -> Option<String>,
    ) -> Self {
        let head = std::iter::once(name.to_owned()).chain(sizes.iter().map(S::to_string)).collect();
        let line = |of: L| {
            let cells: Vec<_> = sizes.iter().map(|size| cell(of, *size)).collect();
            let is_there = cells.iter().any(Option::is_some);
            let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(|| "–".to_owned()).into());
            is_there.then(|| std::iter::once(of.to_string().into()).chain(cells).collect())
        };
        Self { head, rows: lines.filter_map(line).collect() }
    }

    /// The columns of these names alone, in this order.
    #[must_use]
    pub fn only(&self, names: &[&str]) -> Self {
        let at: Vec<usize> =
            names.iter().filter_map(|name| self.head.iter().position(|h| h == name)).collect();
        Self {
            head: at.iter().map(|at| self.head[*at].clone()).collect(),
            rows: self.rows.iter().map(|r| at.iter().map(|at| r[*at].clone()).collect()).collect(),
        }
    }

    /// Cells for readers: numbers with four digits that count.
    fn short(&self) -> Vec<Vec<String>> {
        let text = |cell: &Value| match cell {
            Value::Null => String::new(),
            Value::String(text) => text.clone(),
            Value::Number(number) if number.is_f64() => number_text(number.as_f64().unwrap_or(0.0)),
            value => value.to_string(),
        };
        self.rows.iter().map(|row| row.iter().map(text).collect()).collect()
    }

    /// Whether a column holds text, which stands on the left.
    fn is_left(&self, column: usize) -> bool {
        let text = |row: &Vec<Value>| matches!(row.get(column), Some(Value::String(_)));
        self.rows.iter().any(text)
    }

    /// A Markdown table, its columns in line.
    pub fn markdown(&self) -> String {
        // A bar would end the cell.
        let rows = self.short().into_iter();
        let rows: Vec<Vec<String>> =
            rows.map(|row| row.iter().map(|cell| cell.replace('|', "\\|")).collect()).collect();
        let width = |column: usize| {
            let cells = std::iter::once(&self.head).chain(&rows).filter_map(|row| row.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let columns: Vec<(usize, bool)> =
            (0..self.head.len()).map(|at| (width(at), self.is_left(at))).collect();
        let line = |cells: &Vec<String>| {
            let cells = cells.iter().zip(&columns).map(|(cell, (width, is_left))| {
                if *is_left { format!("| {cell:<width$} ") } else { format!("| {cell:>width$} ") }
            });
            cells.collect::<String>() + "|\n"
        };
        let rule = columns.iter().map(|(width, is_left)| {
            let dashes = "-".repeat(width + 1);
            if *is_left { format!("|{dashes}-") } else { format!("|{dashes}:") }
        });
        line(&self.head)
            + &rule.collect::<String>()
            + "|\n"
            + &rows.iter().map(line).collect::<String>()
    }

    /// One line a row, under a line of names; numbers in full, empty fields where there is none.
    pub fn csv(&self) -> String {
        let field = |text: String| {
            if text.contains([',', '"', '\n']) {
                format!("\"{}\"", text.replace('"', "\"\""))
            } else {
                text
            }
        };
        let cell = |cell: &Value| match cell {
            Value::Null => String::new(),
            Value::String(text) => text.clone(),
            value => value.to_string(),
        };
        let line =
            |cells: Vec<String>| cells.into_iter().map(field).collect::<Vec<_>>().join(",") + "\n";
        let rows = self.rows.iter().map(|row| row.iter().map(cell).collect());
        std::iter::once(self.head.clone()).chain(rows).map(line).collect()
    }

    /// The lines for HTML: tag and class of each cell, and its text.
    pub(super) fn cells(&self) -> Vec<Vec<(String, String)>> {
        let line = |tag: &str, cells: &[String]| {
            let class = |at| if self.is_left(at) { " class=\"name\"" } else { "" };
            let cells = cells.iter().enumerate();
            cells.map(|(at, cell)| (format!("{tag}{}", class(at)), cell.clone())).collect()
        };
        let head = std::iter::once(line("th", &self.head));
        head.chain(self.short().iter().map(|row| line("td", row))).collect()
    }
}

/// A number with four digits that count.
pub fn number_text(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let power = x.abs().log10().floor() as i32;
    if power < -6 {
        return format!("{x:.2e}");
    }
    format!("{x:.*}", (3 - power).clamp(0, 9) as usize)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[derive(Serialize)]
    struct Row {
        name: &'static str,
        ms: Option<f64>,
        at: Value,
    }

    #[test]
    fn every_form_has_every_cell_in_the_order_of_the_fields() {
        let rows = [
            Row { name: "a|b", ms: Some(1.0 / 3.0), at: json!({"p50": 7, "p99": [1, 2]}) },
            Row { name: "c,d", ms: None, at: json!({"p50": 20_000}) },
        ];
        let table = Table::of(&rows);
        assert_eq!(table.head, ["name", "ms", "at.p50", "at.p99.0", "at.p99.1"]);
        let short = table.only(&["name", "at.p50", "ms"]);
        let text = "\
| name | at.p50 |     ms |
|------|-------:|-------:|
| a\\|b |      7 | 0.3333 |
| c,d  |  20000 |        |
";
        assert_eq!(short.markdown(), text);
        let csv = "name,at.p50,ms\na|b,7,0.3333333333333333\n\"c,d\",20000,\n";
        assert_eq!(short.csv(), csv);
        assert_eq!(short.cells()[1][0], ("td class=\"name\"".to_owned(), "a|b".to_owned()));
    }

    #[test]
    fn sizes_have_columns_and_lines_without_a_cell_are_left_out() {
        let cell = |line: &str, size: u32| (line == "x" && size > 1).then(|| size.to_string());
        let table = Table::by_size("who", ["x", "y"].into_iter(), &[1, 2], cell);
        assert_eq!(table.csv(), "who,1,2\nx,–,2\n");
        assert_eq!([0.0, 12.3456, 1e-9].map(number_text), ["0", "12.35", "1.00e-9"]);
    }
}
