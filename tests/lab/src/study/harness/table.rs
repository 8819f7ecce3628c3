//! Tables: cells under a head, as Markdown, CSV and HTML. Rows are what JSON has of them: a column a field, named as
//! the field is, so that every form of a result has the same words.

use indexmap::IndexMap;
use serde::Serialize;
use serde_json::Value;

/// A row of a table: fields in the order in which they are written.
pub type Fields = IndexMap<String, Value>;

/// A row of `name: value` and of variables of the field's name.
macro_rules! row {
    ($($name:ident $(: $value:expr)?),* $(,)?) => {
        $crate::study::harness::Fields::from_iter([
            $((stringify!($name).to_owned(), row!(@ $name $($value)?))),*
        ])
    };
    (@ $name:ident) => { serde_json::json!($name) };
    (@ $name:ident $value:expr) => { serde_json::json!($value) };
}
pub(crate) use row;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    pub head: Vec<String>,
    pub rows: Vec<Vec<Value>>,
}

/// The fields of a row, in their order. Rows are objects that have a JSON form: reports are printed as such.
pub fn fields(row: &impl Serialize) -> Fields {
    let text = serde_json::to_string(row).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

impl Table {
    /// A table with a column for every field of the rows, those of inner objects and lists with the outer names
    /// before theirs. A row that lacks a field of others has an empty cell there.
    pub fn of<R: Serialize>(rows: &[R]) -> Self {
        let mut table = Self::default();
        for row in rows {
            let mut cells = Vec::new();
            for (name, value) in fields(row) {
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
                let at = self.column(&name).unwrap_or_else(|| {
                    self.head.push(name);
                    self.head.len() - 1
                });
                cells.resize(self.head.len(), Value::Null);
                cells[at] = value;
            }
        }
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.head.iter().position(|head| head == name)
    }

    pub fn cell<'a>(&self, row: &'a [Value], name: &str) -> &'a Value {
        self.column(name).and_then(|at| row.get(at)).unwrap_or(&Value::Null)
    }

    pub fn of_texts<const N: usize>(
        head: [&str; N],
        rows: impl IntoIterator<Item = [String; N]>,
    ) -> Self {
        let rows = rows.into_iter().map(|row| row.map(Value::from).to_vec());
        Self { head: head.map(str::to_owned).to_vec(), rows: rows.collect() }
    }

    /// The columns of these names alone, with commas between, in this order.
    #[must_use]
    pub fn only(&self, names: &str) -> Self {
        let at: Vec<usize> = names.split(',').filter_map(|name| self.column(name)).collect();
        Self {
            head: at.iter().map(|at| self.head[*at].clone()).collect(),
            rows: self.rows.iter().map(|r| at.iter().map(|at| r[*at].clone()).collect()).collect(),
        }
    }

    pub(super) fn lines(&self) -> Vec<Vec<String>> {
        let text = |cell: &Value| match cell {
            Value::Number(number) if number.is_f64() => number_text(number.as_f64().unwrap_or(0.0)),
            cell => plain(cell),
        };
        let rows = self.rows.iter().map(|row| row.iter().map(text).collect());
        std::iter::once(self.head.clone()).chain(rows).collect()
    }

    pub(super) fn is_left(&self, column: usize) -> bool {
        self.rows.iter().any(|row| row.get(column).is_some_and(Value::is_string))
    }

    /// A Markdown table, its columns in line.
    pub fn markdown(&self) -> String {
        // A bar would end the cell.
        let mut lines = self.lines();
        lines.iter_mut().flatten().for_each(|cell| *cell = cell.replace('|', "\\|"));
        let width = |at: usize| lines.iter().map(|line| line[at].chars().count()).max();
        let columns: Vec<(usize, bool)> =
            (0..self.head.len()).map(|at| (width(at).unwrap_or(0), self.is_left(at))).collect();
        let line = |cells: &Vec<String>| {
            let cells = cells.iter().zip(&columns).map(|(cell, (width, is_left))| {
                if *is_left { format!("| {cell:<width$} ") } else { format!("| {cell:>width$} ") }
            });
            cells.collect::<String>() + "|\n"
        };
        let rule = columns.iter().map(|(width, is_left)| {
            format!("|{}{}", "-".repeat(width + 1), if *is_left { '-' } else { ':' })
        });
        let rule = rule.collect::<String>() + "|\n";
        line(&lines[0]) + &rule + &lines[1..].iter().map(line).collect::<String>()
    }

    /// One line a row, under a line of names; numbers in full, empty fields where there is none.
    pub fn csv(&self) -> String {
        let field = |text: String| {
            let quoted = || format!("\"{}\"", text.replace('"', "\"\""));
            if text.contains([',', '"', '\n']) { quoted() } else { text }
        };
        let line =
            |cells: Vec<String>| cells.into_iter().map(field).collect::<Vec<_>>().join(",") + "\n";
        let rows = self.rows.iter().map(|row| row.iter().map(plain).collect());
        std::iter::once(self.head.clone()).chain(rows).map(line).collect()
    }
}

pub(super) fn plain(cell: &Value) -> String {
    match cell {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        value => value.to_string(),
    }
}

/// A number with four digits that count, without zeros at its end; all digits of whole numbers.
pub fn number_text(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let power = x.abs().log10().floor() as i32;
    if power < -6 {
        return format!("{x:.2e}");
    }
    let text = format!("{x:.*}", (3 - power).clamp(0, 9) as usize);
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if text.contains('.') { short.to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn every_form_has_every_cell_in_the_order_of_the_fields() {
        let rows = [
            row!(name: "a|b", ms: 1.0 / 3.0, at: json!({"p50": 7, "p99": [1, 2]})),
            row!(name: "c,d", at: json!({"p50": 20_000})),
        ];
        let table = Table::of(&rows);
        assert_eq!(table.head, ["name", "ms", "at.p50", "at.p99.0", "at.p99.1"]);
        let short = table.only("name,at.p50,ms");
        let text = "\
| name | at.p50 |     ms |
|------|-------:|-------:|
| a\\|b |      7 | 0.3333 |
| c,d  |  20000 |        |
";
        assert_eq!(short.markdown(), text);
        let csv = "name,at.p50,ms\na|b,7,0.3333333333333333\n\"c,d\",20000,\n";
        assert_eq!(short.csv(), csv);
        let text = [0.0, 0.27, 29.66, 1.0, 71_452.0, 0.000_031, 1234.5, 1e-9].map(number_text);
        assert_eq!(text, ["0", "0.27", "29.66", "1", "71452", "0.000031", "1234", "1.00e-9"]);
    }
}
