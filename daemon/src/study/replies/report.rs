//! The forms for people, and as the JSON that `CLI.md` documents.

use std::fmt;

use serde::Serialize;

use super::measure::FormRow;
use super::smallest::{SmallestRow, smallest};

/// The fields of `bench replies --json` on forms. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormsReport {
    /// Every form of every mask.
    forms: Vec<FormRow>,
    /// The smallest ones.
    smallest: Vec<SmallestRow>,
}

impl FormsReport {
    /// The report of some rows.
    pub fn new(forms: Vec<FormRow>) -> Self {
        Self { smallest: smallest(&forms), forms }
    }
}

impl fmt::Display for FormsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "Forms of the sparse mask of cpu-grid: bytes, and decoding on one thread\n")?;
        write!(
            f,
            "{:>9} {:>9}  {:<8} {:>11} {:>13} {:>12} {:>12} {:>12} {:>13}",
            "scene",
            "n",
            "form",
            "entries",
            "bytes",
            "bytes/pair",
            "order kept",
            "decode µs",
            "of production"
        )?;
        let a_pair = |bytes: Option<f64>| bytes.map_or("-".to_owned(), |b| format!("{b:.2}"));
        for row in &self.forms {
            write!(
                f,
                "\n{:>9} {:>9}  {:<8} {:>11} {:>13} {:>12} {:>12} {:>12.1} {:>13.2}",
                row.scene,
                row.n,
                row.form,
                row.entries,
                row.bytes,
                a_pair(row.bytes_a_pair),
                a_pair(row.order_kept_bytes_a_pair),
                row.decode_ns as f64 / 1e3,
                row.decode_ratio
            )?;
        }
        write!(
            f,
            "\n\nThe smallest form, against the sparse one with its order; the link at 52 GB/s\n\n\
             {:>9} {:>9}  {:<5}  {:<8} {:>13} {:>13} {:>14} {:>15}",
            "scene",
            "n",
            "order",
            "form",
            "bytes",
            "sparse bytes",
            "link saves µs",
            "decode more µs"
        )?;
        for row in &self.smallest {
            write!(
                f,
                "\n{:>9} {:>9}  {:<5}  {:<8} {:>13} {:>13} {:>14.1} {:>15.1}",
                row.scene,
                row.n,
                row.order.as_str(),
                row.form,
                row.bytes,
                row.sparse_bytes,
                row.link_saved_us,
                row.decode_more_us
            )?;
        }
        Ok(())
    }
}
