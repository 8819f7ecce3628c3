//! The report as Markdown.

use std::fmt::Write as _;

use super::{Other, SweepReport, SweepRow, SweepTimes};
use crate::study::machine::Machine;

/// The report as Markdown.
pub fn markdown(report: &SweepReport) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write(report, &mut text);
    text
}

fn write(report: &SweepReport, out: &mut String) -> std::fmt::Result {
    let Machine { cpu, threads, gpu, driver, rustc, commit, command, .. } = &report.machine;
    writeln!(out, "# Sweep and prune on the GPU\n")?;
    let (gpu, driver) = (gpu.as_deref().unwrap_or("-"), driver.as_deref().unwrap_or("-"));
    writeln!(out, "{gpu} ({driver}); {cpu}, {threads} threads; rustc {rustc}; commit {commit}")?;
    writeln!(out, "`{command}`")?;
    if report.machine.gpu_is_software || !report.machine.optimised {
        writeln!(out, "\nA software adapter or an unoptimised build: times mean little.")?;
    }
    writeln!(
        out,
        "\nGPU's clock, medians, µs, transfers included: boxes in host memory, a list of pairs in host memory. Every \
         engine's pairs are those of the cores' grid. Ratio: the sweep's time by that of the faster engine.\n"
    )?;
    writeln!(
        out,
        "| scene | n | pairs | tubes | entries | sweep: tests a box | transfers | keys | sort | pairs | in all \
         | gpu-grid: tests a box | in all | gpu-brute | ratio |"
    )?;
    writeln!(out, "|{}", "---|".repeat(15))?;
    for row in &report.rows {
        write_row(row, out)?;
    }
    let won: Vec<String> = report
        .rows
        .iter()
        .filter(|row| row.is_won())
        .map(|row| format!("{} {}", row.scene, row.n))
        .collect();
    match won.as_slice() {
        [] => writeln!(out, "\nThe sweep is the fastest nowhere."),
        won => writeln!(out, "\nThe sweep is the fastest in: {}.", won.join(", ")),
    }
}

fn write_row(row: &SweepRow, out: &mut String) -> std::fmt::Result {
    let a_box = |tests: u64| tests as f64 / f64::from(row.n.max(1));
    write!(out, "| {} | {} | {} |", row.scene, row.n, row.pairs)?;
    match &row.sweep {
        Some(SweepTimes { entries, tubes, tested, parts_us, all_us, .. }) => {
            let [transfers, keys, sort, pairs] = parts_us;
            write!(out, " {tubes} | {entries} | {:.1} |", a_box(*tested))?;
            write!(out, " {transfers:.0} | {keys:.0} | {sort:.0} | {pairs:.0} | {all_us:.0} |")?;
        }
        None => write!(out, " | | refused | | | | | |")?,
    }
    match &row.grid {
        Some(Other { tested, all_us }) => write!(out, " {:.1} | {all_us:.0} |", a_box(*tested))?,
        None => write!(out, " refused | |")?,
    }
    let all_pairs = row.all_pairs.as_ref().map(|other| format!("{:.0}", other.all_us));
    let ratio = row.ratio().map(|ratio| format!("{ratio:.2}"));
    writeln!(out, " {} | {} |", all_pairs.unwrap_or_default(), ratio.unwrap_or_default())
}
