//! The report as CSV: one line a figure, for spreadsheets and plots.

use std::fmt::{Display, Write};

use super::super::errors::{Coverage, Tally};
use super::super::rows::Scope;
use super::MappingReport;

struct Lines(String);

impl Lines {
    /// A figure and the paper's. `what` is a variant or a root.
    fn push(
        &mut self,
        table: &str,
        processor: impl Display,
        what: impl Display,
        size: u64,
        (metric, value): (&str, Option<f64>),
        paper: Option<f64>,
    ) {
        let text = |figure: Option<f64>| figure.map(|x| x.to_string()).unwrap_or_default();
        // "cpu, one thread" has a comma. Writing to a String cannot fail.
        let _ = writeln!(
            self.0,
            "{table},\"{processor}\",{what},{size},{metric},{},{}",
            text(value),
            text(paper)
        );
    }
}

/// The report as CSV, the machine in comment lines at its head.
pub fn csv(report: &MappingReport) -> String {
    let mut lines = Lines(String::new());
    let machine = &report.machine;
    for (name, value) in [
        ("cpu", machine.cpu.as_str()),
        ("gpu", machine.gpu.as_deref().unwrap_or("none")),
        ("driver", machine.driver.as_deref().unwrap_or("none")),
        ("rustc", &machine.rustc),
        ("commit", &machine.commit),
        ("command", &machine.command),
    ] {
        let _ = writeln!(lines.0, "# {name}: {value}");
    }
    lines.0 += "table,processor,variant,size,metric,value,paper\n";
    for row in &report.root_errors {
        let (what, size) = (row.root, row.tally.count);
        let inexact = 100.0 * row.tally.inexact as f64 / size.max(1) as f64;
        let other = ("wrong_percent", Some(row.percent()));
        lines.push("table_3", row.processor, what, size, other, row.paper_percent);
        lines.push("table_3", row.processor, what, size, ("inexact_percent", Some(inexact)), None);
    }
    for row in &report.pair_errors {
        let mut push = |metric: &str, value: f64| {
            let (what, size) = (row.variant, u64::from(row.n));
            lines.push("errors", row.processor, what, size, (metric, Some(value)), None);
        };
        let Tally { ids, skipped, wrong, .. } = row.tally;
        push("exhaustive", f64::from(u8::from(row.scope == Scope::All)));
        push("ids", ids as f64);
        push("skipped", skipped as f64);
        push("wrong", wrong as f64);
        push("wrong_share", row.tally.wrong_share());
        push("largest_row_error", row.largest_row_error() as f64);
        if let Some(k) = row.tally.first_wrong {
            push("first_wrong_id", k as f64);
        }
        match row.coverage {
            Coverage::Counted { missed, repeated } => {
                push("missed_share", missed);
                push("repeated_share", repeated);
            }
            Coverage::Bounded { missed_least, missed_most, repeated_most } => {
                push("missed_share_least", missed_least);
                push("missed_share_most", missed_most);
                push("repeated_share_most", repeated_most);
            }
        }
        if let Some(ends) = row.row_ends {
            push("row_end_ids", ends.ids as f64);
            push("row_end_wrong", ends.wrong as f64);
        }
    }
    for row in &report.first_wrong {
        let value = ("first_wrong_boxes", row.n.map(f64::from));
        lines.push("errors", "mirror", row.variant, u64::from(row.limit), value, None);
    }
    for row in &report.map_times {
        let (who, what, size) = (row.processor, row.variant, u64::from(row.n));
        lines.push("table_2", who, what, size, ("ms", row.ms), row.paper_ms);
        lines.push("table_2", who, what, size, ("ps_per_pair", row.ps_per_pair()), None);
    }
    for row in &report.root_times {
        lines.push("table_4", row.processor, row.root, row.count, ("ms", row.ms), row.paper_ms);
    }
    for row in &report.outputs {
        let writer = if row.thread_a_pair { "thread-a-pair" } else { "thread-a-word" };
        let what = format!("{}-bit {writer}", row.bits_per_pair);
        for (metric, value, paper) in [
            ("kernel_ms", row.kernel_ms, row.paper_kernel_ms),
            ("transfer_us", row.transfer_us, row.paper_transfer_us),
            ("output_bytes", row.output_bytes as f64, None),
        ] {
            lines.push("table_5", "gpu", &what, u64::from(row.n), (metric, Some(value)), paper);
        }
    }
    for row in &report.growth {
        for (metric, value, paper) in [
            ("kernel_ms", row.kernel_ms, row.paper_kernel_ms),
            ("upload_us", row.upload_us, None),
            ("transfer_us", row.transfer_us, None),
            ("input_bytes", row.input_bytes as f64, None),
            ("output_bytes", row.output_bytes as f64, None),
        ] {
            let size = u64::from(row.n);
            lines.push("figure_4", "gpu", "1-bit", size, (metric, Some(value)), paper);
        }
    }
    lines.0
}
