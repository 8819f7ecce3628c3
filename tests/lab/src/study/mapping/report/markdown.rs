//! The report for readers: a table each for the paper's tables, the paper's figures in brackets.

use std::fmt::{Display, Write};

use crate::study::mapping::stage::{Root, Variant};

use super::super::errors::Coverage;
use super::super::rows::{PairErrorRow, Processor, Scope};
use super::MappingReport;
use crate::study::verdict::Verdict;

const PROCESSORS: [Processor; 3] = [Processor::CpuThread, Processor::Cpu, Processor::Gpu];

/// A Markdown table.
fn table(text: &mut String, header: &[String], rows: &[Vec<String>]) {
    let mut line = |cells: &[String]| {
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    };
    line(header);
    line(&vec!["---".to_owned(); header.len()]);
    for row in rows {
        line(row);
    }
    text.push('\n');
}

/// A table with a column for each size: `cell` gives the figure and the paper's.
fn by_size<W: Display + Copy, S: Display + Copy>(
    text: &mut String,
    names: &str,
    whats: impl Iterator<Item = W>,
    sizes: &[S],
    cell: impl Fn(W, S) -> Option<String>,
) {
    let header: Vec<String> =
        std::iter::once(names.to_owned()).chain(sizes.iter().map(ToString::to_string)).collect();
    let mut rows = Vec::new();
    for what in whats {
        let cells: Vec<_> = sizes.iter().map(|size| cell(what, *size)).collect();
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(|| "–".into()));
            rows.push(std::iter::once(what.to_string()).chain(cells).collect());
        }
    }
    table(text, &header, &rows);
}

/// A figure with four digits that count.
fn number(x: f64) -> String {
    let digits = if x == 0.0 { 0 } else { (3 - x.abs().log10().floor() as i32).clamp(0, 7) };
    format!("{x:.*}", digits as usize)
}

fn with_paper(figure: f64, paper: Option<f64>) -> String {
    match paper {
        Some(paper) => format!("{} ({paper})", number(figure)),
        None => number(figure),
    }
}

fn sizes<T: Ord + Copy>(of: impl Iterator<Item = T>) -> Vec<T> {
    let mut sizes: Vec<T> = of.collect();
    sizes.sort_unstable();
    sizes.dedup();
    sizes
}

/// The report as Markdown.
pub fn markdown(report: &MappingReport) -> String {
    let mut text = String::from("# The mapping function: run time against error\n\n");
    machine(report, &mut text);
    claims(report, &mut text);
    root_errors(report, &mut text);
    pair_errors(report, &mut text);
    map_times(report, &mut text);
    root_times(report, &mut text);
    outputs(report, &mut text);
    growth(report, &mut text);
    text
}

fn machine(report: &MappingReport, text: &mut String) {
    let machine = &report.machine;
    let gpu = machine.gpu.as_deref().unwrap_or("none");
    let driver = machine.driver.as_deref().unwrap_or("none");
    let _ = writeln!(
        text,
        "Avril, Gouranton and Arnaldi, EGPGV 2012, §3, measured again. The paper's figures are in \
         brackets (Quadro FX 3600M, Core 2 Duo X7900).\n\n\
         * CPU: {}, {} threads\n* GPU: {gpu}{}, driver {driver}\n* Build: {}, commit {}{}\n\
         * Command: `{}`\n",
        machine.cpu,
        machine.threads,
        if machine.gpu_is_software { " (software: its times are the CPU's)" } else { "" },
        machine.rustc,
        machine.commit,
        if machine.optimised { "" } else { ", **not optimised: times mean nothing**" },
        machine.command,
    );
}

fn claims(report: &MappingReport, text: &mut String) {
    text.push_str("## What holds and what breaks\n\n");
    let header = ["paper", "says", "here", "figures"].map(str::to_owned);
    let rows: Vec<Vec<String>> = report
        .claims
        .iter()
        .map(|claim| {
            let verdict = match claim.verdict {
                Verdict::Breaks => format!("**{}**", claim.verdict),
                Verdict::Holds | Verdict::NotMeasured => claim.verdict.to_string(),
            };
            vec![claim.place.into(), claim.claim.into(), verdict, claim.evidence.clone()]
        })
        .collect();
    table(text, &header, &rows);
    let header = ["closed form", "first wrong at so many boxes"].map(str::to_owned);
    let rows: Vec<Vec<String>> = report
        .first_wrong
        .iter()
        .map(|row| {
            let n = row.n.map_or_else(|| format!("none up to {}", row.limit), |n| n.to_string());
            vec![row.variant.to_string(), n]
        })
        .collect();
    text.push_str(
        "Numbers of boxes from which a row starts or ends wrongly, by the f32 arithmetic of a \
         CPU (correctly rounded, no fused operations):\n\n",
    );
    table(text, &header, &rows);
}

fn root_errors(report: &MappingReport, text: &mut String) {
    text.push_str(
        "## Table 3: integer parts of roots that are wrong, %\n\n\
         Of √1 to √N in f32, against the built-in root of the same processor; for `sqrt` itself \
         against the exact integer root. The paper says that four steps give the figures of three.\n\n",
    );
    let sizes = sizes(report.root_errors.iter().map(|row| row.tally.count));
    for processor in PROCESSORS {
        let of_it: Vec<_> =
            report.root_errors.iter().filter(|row| row.processor == processor).collect();
        if of_it.is_empty() {
            continue;
        }
        by_size(text, &processor.to_string(), Root::all(), &sizes, |root, size| {
            let row = of_it.iter().find(|row| row.root == root && row.tally.count == size)?;
            let percent = match root {
                Root::BuiltIn => 100.0 * row.tally.inexact as f64 / size as f64,
                Root::Newton(..) => row.percent(),
            };
            Some(with_paper(percent, row.paper_percent))
        });
    }
}

fn pair_errors(report: &MappingReport, text: &mut String) {
    text.push_str(
        "## Wrong pairs by number of boxes\n\n\
         Share of ids that are mapped to another pair or to none, then the largest distance from \
         the right row. *Sampled* figures carry `~`; beside the sample, the first and last id of every row are looked at (on the \
         GPU 16 on either side), and where only they are wrong, their number stands there. Ids are counted in the \
         variant's own order (fold, lazy); in the GPU's figures ids have 32 bits as long as they \
         fit, then 64.\n\n",
    );
    let sizes = sizes(report.pair_errors.iter().map(|row| row.n));
    for processor in PROCESSORS {
        let of_it: Vec<_> =
            report.pair_errors.iter().filter(|row| row.processor == processor).collect();
        if of_it.is_empty() {
            continue;
        }
        by_size(text, &processor.to_string(), Variant::all(), &sizes, |variant, n| {
            of_it.iter().find(|row| row.variant == variant && row.n == n).map(|row| wrong(row))
        });
        text.push_str("Pairs missed / tests of a pair that was tested before, share of all pairs");
        text.push_str(" (`≤` and ranges: bounds from the sample, see `errors::Coverage`):\n\n");
        by_size(text, &processor.to_string(), Variant::all(), &sizes, |variant, n| {
            let row = of_it.iter().find(|row| row.variant == variant && row.n == n)?;
            Some(coverage(row))
        });
    }
}

fn wrong(row: &PairErrorRow) -> String {
    let sampled = if row.scope == Scope::Sample { "~" } else { "" };
    if !row.is_wrong() {
        return format!("{sampled}0");
    }
    let off = row.largest_row_error();
    match row.tally.wrong {
        0 => {
            let ends = row.row_ends.map_or(0, |ends| ends.wrong);
            format!("{sampled}0, {ends} at row ends, ±{off}")
        }
        _ => format!("{sampled}{:.2e}, ±{off}", row.tally.wrong_share()),
    }
}

fn coverage(row: &PairErrorRow) -> String {
    let share = |x: f64| if x == 0.0 { "0".to_owned() } else { format!("{x:.2e}") };
    match row.coverage {
        Coverage::Counted { missed, repeated } => {
            format!("{} / {}", share(missed), share(repeated))
        }
        Coverage::Bounded { missed_least, missed_most, repeated_most } => {
            let missed = if missed_least == missed_most {
                format!("~{}", share(missed_most))
            } else {
                format!("~{} to {}", share(missed_least), share(missed_most))
            };
            let ends = match row.row_ends {
                Some(ends) if row.tally.wrong == 0 && ends.wrong > 0 => {
                    format!(", ≤{} at row ends", ends.wrong)
                }
                _ => String::new(),
            };
            format!("{missed}{ends} / ≤{}", share(repeated_most))
        }
    }
}

fn map_times(report: &MappingReport, text: &mut String) {
    text.push_str(
        "## Table 2: time to map all ids, ms\n\n\
         With the paper's closed form (`closed sqrt`), the lazy way, and all others. One thread of \
         the GPU takes 32 ids. CPU times past 2^24 ids are scaled up from so many. `–` would take \
         longer than the study waits. The paper's kernel tests boxes too, and its times grow as \
         n and not as n², so only the ratio compares.\n\n",
    );
    let sizes = sizes(report.map_times.iter().map(|row| row.n));
    for processor in PROCESSORS {
        let of_it: Vec<_> =
            report.map_times.iter().filter(|row| row.processor == processor).collect();
        if of_it.is_empty() {
            continue;
        }
        by_size(text, &processor.to_string(), Variant::all(), &sizes, |variant, n| {
            let row = of_it.iter().find(|row| row.variant == variant && row.n == n)?;
            let pair =
                row.ps_per_pair().map_or_else(String::new, |ps| format!(", {ps:.1} ps/pair"));
            Some(with_paper(row.ms?, row.paper_ms) + &pair)
        });
    }
}

fn root_times(report: &MappingReport, text: &mut String) {
    text.push_str(
        "## Table 4: time to take roots, ms\n\n\
         The integer parts of √1 to √N, summed. The paper does not say how many steps it timed; \
         its figure stands beside each.\n\n",
    );
    let sizes = sizes(report.root_times.iter().map(|row| row.count));
    for processor in PROCESSORS {
        let of_it: Vec<_> =
            report.root_times.iter().filter(|row| row.processor == processor).collect();
        if of_it.is_empty() {
            continue;
        }
        by_size(text, &processor.to_string(), Root::all(), &sizes, |root, count| {
            let row = of_it.iter().find(|row| row.root == root && row.count == count)?;
            row.ms.map(|ms| with_paper(ms, row.paper_ms))
        });
    }
}

fn outputs(report: &MappingReport, text: &mut String) {
    if report.outputs.is_empty() {
        return;
    }
    text.push_str(
        "## Table 5: one byte or one bit a pair\n\n\
         The corrected closed form, keys in video memory, output copied to host memory. As in the \
         paper each thread has one pair and ORs its result into the output; beside it, each thread \
         computes a whole word and no word has two writers. WGSL has no byte stores, so bytes are \
         written four to a word.\n\n",
    );
    let header = ["boxes", "a pair is", "threads", "kernel ms", "transfer µs", "bytes"];
    let rows: Vec<Vec<String>> = report
        .outputs
        .iter()
        .map(|row| {
            vec![
                row.n.to_string(),
                if row.bits_per_pair == 8 { "a byte".into() } else { "a bit".into() },
                if row.thread_a_pair { "one a pair, OR".into() } else { "one a word".into() },
                with_paper(row.kernel_ms, row.paper_kernel_ms),
                with_paper(row.transfer_us, row.paper_transfer_us),
                row.output_bytes.to_string(),
            ]
        })
        .collect();
    table(text, &header.map(str::to_owned), &rows);
}

fn growth(report: &MappingReport, text: &mut String) {
    if report.growth.is_empty() {
        return;
    }
    text.push_str(
        "## Figure 4: kernel, input and output by number of boxes\n\n\
         One bit a pair, one thread a word. The figure has no numbers; table 5's stand here.\n\n",
    );
    let header = ["boxes", "kernel ms", "input bytes", "upload µs", "output bytes", "transfer µs"];
    let rows: Vec<Vec<String>> = report
        .growth
        .iter()
        .map(|row| {
            vec![
                row.n.to_string(),
                with_paper(row.kernel_ms, row.paper_kernel_ms),
                row.input_bytes.to_string(),
                number(row.upload_us),
                row.output_bytes.to_string(),
                number(row.transfer_us),
            ]
        })
        .collect();
    table(text, &header.map(str::to_owned), &rows);
}
