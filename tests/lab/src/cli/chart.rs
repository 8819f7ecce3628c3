//! `chart`: rows of a report as lines, from the JSON that a command printed.

use std::fs;
use std::path::PathBuf;

use clap::Args;
use pairmaskd::cli::output::print_text;
use pairmaskd::file_error::{Access, FileError};
use serde_json::Value;

use crate::Result;
use crate::study::harness::plot::{Look, Plot, standalone};
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
    pub fn run(&self) -> Result<()> {
        let Self { file, rows, x, y, by } = self;
        let text = fs::read_to_string(file).map_err(FileError::of(file, Access::Read))?;
        let wrong = |why: String| format!("{}: not such a record: {why}", file.display());
        let report: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
        let found = report[rows].as_array();
        let found = found.ok_or_else(|| wrong(format!("it has no list `{rows}`")))?;
        let [y_fields, by] = [y, by].map(|fields| fields.iter().map(String::as_str));
        let (y_fields, by): (Vec<_>, Vec<_>) = (y_fields.collect(), by.collect());
        let plot = Plot::of(&Table::of(found), x, &y_fields, &by, Look::Line);
        if plot.series.is_empty() {
            return Err(wrong(format!("no row has `{x}` and one of {}", y.join(", "))).into());
        }
        let of = |name: &str| report["machine"][name].as_str().unwrap_or_default();
        let lines = [format!("{}; commit {}", of("cpu"), of("commit")), of("command").to_owned()];
        Ok(print_text(standalone(&file.display().to_string(), &lines, &plot).trim_end())?)
    }
}
