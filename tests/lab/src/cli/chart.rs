//! `chart`: rows of a report as lines, from the JSON that a command printed.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use clap::Args;
use pairmaskd::cli::output::print_text;
use pairmaskd::file_error::{Access, FileError};
use serde_json::Value;

use crate::study::harness::StudyError;
use crate::study::harness::plot::{Axis, Look, Plot, Series, Unit, standalone};
use crate::study::harness::table::Table;

/// Rows of a report as lines of an SVG file, on logarithmic axes
#[derive(Debug, Args)]
#[command(after_help = "\
Fields are named as in the JSON, inner ones behind a point: total_ns.p50. There is a line for every field of
--y and every setting of the fields of --by, in the order of --x. Rows without a number are left out.

Examples:
  pairmaskd bench latency --n 1000,10000,100000 --json > latency.json
  pairmask-lab chart latency.json --x n --y round_trip_ns.p50,round_trip_ns.p99 --by precision > latency.svg
  pairmask-lab chart threads.json --x threads --y least_ns,paper_ns --by stage,scene,n,engine > threads.svg")]
pub struct Chart {
    /// The report
    file: PathBuf,
    /// The list of rows in it
    #[arg(long, value_name = "FIELD", default_value = "rows")]
    rows: String,
    /// What is along the horizontal axis
    #[arg(long, value_name = "FIELD")]
    x: String,
    /// What is drawn
    #[arg(long, value_name = "FIELD,..", value_delimiter = ',', required = true)]
    y: Vec<String>,
    /// What tells lines apart
    #[arg(long, value_name = "FIELD,..", value_delimiter = ',')]
    by: Vec<String>,
}

impl Chart {
    pub fn run(&self) -> Result<(), StudyError> {
        let text =
            fs::read_to_string(&self.file).map_err(FileError::of(&self.file, Access::Read))?;
        let wrong = |why: String| StudyError::Record { path: self.file.clone(), why };
        let report: Value =
            serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        let rows = report[&self.rows].as_array();
        let rows = rows.ok_or_else(|| wrong(format!("it has no list `{}`", self.rows)))?;
        let series = self.series(&Table::of(rows));
        if series.is_empty() {
            return Err(wrong(format!("no row has `{}` and one of {}", self.x, self.y.join(", "))));
        }
        let y = self.y.join(", ");
        let plot = Plot {
            title: format!("{y} by {}", self.x),
            x: Axis::new(&self.x, unit(&self.x)),
            y: Axis::new(&y, unit(&self.y[0])),
            series,
            level: None,
        };
        let of = |name: &str| report["machine"][name].as_str().unwrap_or_default();
        let lines = [format!("{}; commit {}", of("cpu"), of("commit")), of("command").to_owned()];
        let name = self.file.display().to_string();
        Ok(print_text(standalone(&name, &lines, &[plot]).trim_end())?)
    }

    fn series(&self, table: &Table) -> Vec<Series> {
        let mut lines: BTreeMap<(String, usize), Vec<(f64, f64)>> = BTreeMap::new();
        let at = |name: &String| table.head.iter().position(|head| head == name);
        for row in &table.rows {
            let cell = |name: &String| at(name).map_or(&Value::Null, |at| &row[at]);
            let setting = self.by.iter().map(|name| match cell(name) {
                Value::String(text) => text.clone(),
                value => format!("{name} {value}"),
            });
            let setting = setting.collect::<Vec<_>>().join(", ");
            for (number, y) in self.y.iter().enumerate() {
                if let (Some(x), Some(height)) = (cell(&self.x).as_f64(), cell(y).as_f64()) {
                    let name =
                        if self.y.len() > 1 { format!("{setting} {y}") } else { setting.clone() };
                    lines.entry((name, number)).or_default().push((x, height));
                }
            }
        }
        let mut series = Vec::new();
        for (colour, ((name, _), mut points)) in lines.into_iter().enumerate() {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            series.push(Series::line(name.trim(), colour, Look::Line, &points));
        }
        series
    }
}

/// How numbers of a field are written.
fn unit(field: &str) -> Unit {
    if field.split('.').any(|part| part.ends_with("_ns")) {
        Unit::Nanoseconds
    } else if field.contains("bytes") {
        Unit::Bytes
    } else if ["n", "threads", "clients", "count"].contains(&field) {
        Unit::Count
    } else {
        Unit::Ratio
    }
}
