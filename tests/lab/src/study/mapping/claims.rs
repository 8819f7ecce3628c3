//! The paper's claims, judged by the figures of a study.

use crate::study::mapping::stage::{Discriminant, Magic, Root, Steps, Variant};
use crate::study::verdict::Verdict;
use serde::Serialize;

use super::MappingReport;
use super::rows::{MapTimeRow, OutputRow, PAPERS_OWN, PairErrorRow, Processor, RootErrorRow};

/// A claim and its verdict.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Claim {
    /// Its place in the paper.
    pub place: &'static str,
    /// The claim, paraphrased.
    pub claim: &'static str,
    /// Whether it holds.
    pub verdict: Verdict,
    /// The figures.
    pub evidence: String,
}

/// Judges every claim.
pub(super) fn judge(report: &MappingReport) -> Vec<Claim> {
    vec![
        closed_form(report),
        corrections(report),
        one_row_off(report),
        fourth_step(report),
        newton_faster(report),
        lazy_slower_on_gpus(report),
        lazy_faster_on_cpus(report),
        kernel_same_for_bits(report),
        transfer_smaller_for_bits(report),
    ]
}

fn verdict(holds: Option<bool>) -> Verdict {
    match holds {
        Some(true) => Verdict::Holds,
        Some(false) => Verdict::Breaks,
        None => Verdict::NotMeasured,
    }
}

const fn closed(root: Root, corrected: bool) -> Variant {
    Variant::Closed { root, discriminant: Discriminant::Float, corrected }
}

/// Fewest boxes for which each processor found the variant wrong, or that it found none.
fn found_wrong(report: &MappingReport, variant: Variant) -> (Option<bool>, String) {
    let rows = || report.pair_errors.iter().filter(move |row| row.variant == variant);
    let mut parts = Vec::new();
    let first = report.first_wrong.iter().find(|row| row.variant == variant);
    if let Some(row) = first {
        parts.push(match row.n {
            Some(n) => format!("{variant}: first wrong at {n} boxes (mirror)"),
            None => format!("{variant}: right up to {} boxes (mirror)", row.limit),
        });
    }
    for processor in [Processor::Cpu, Processor::Gpu] {
        let of_it = || rows().filter(move |row| row.processor == processor);
        if let Some(row) = of_it().find(|row| row.is_wrong()) {
            let off = row.largest_row_error();
            parts.push(format!("wrong in the {processor}'s row of {} boxes, by {off} rows", row.n));
        } else if let Some(row) = of_it().next_back() {
            parts.push(format!("none wrong on the {processor} up to {} boxes", row.n));
        }
    }
    let measured = rows().next().is_some();
    let wrong = rows().any(PairErrorRow::is_wrong) || first.is_some_and(|row| row.n.is_some());
    (measured.then_some(!wrong), parts.join("; "))
}

fn closed_form(report: &MappingReport) -> Claim {
    let (holds, evidence) = found_wrong(report, PAPERS_OWN);
    Claim {
        place: "§3.2.1",
        claim: "formulas 1 and 2 give each thread its own pair",
        verdict: verdict(holds),
        evidence,
    }
}

fn corrections(report: &MappingReport) -> Claim {
    let roots = [
        Root::BuiltIn,
        Root::Newton(Magic::Carmack, Steps::Two),
        Root::Newton(Magic::Lomont, Steps::Three),
    ];
    let found: Vec<_> = roots.map(|root| found_wrong(report, closed(root, true))).into();
    let holds = found.iter().filter_map(|(holds, _)| *holds).reduce(|a, b| a && b);
    let integer = Variant::Closed {
        root: Root::BuiltIn,
        discriminant: Discriminant::Integer,
        corrected: true,
    };
    let mut evidence: Vec<_> = found.into_iter().map(|(_, text)| text).collect();
    evidence.push(format!("with the subtraction in integers: {}", found_wrong(report, integer).1));
    Claim {
        place: "§3.3",
        claim: "with the two corrections no pair is wrong",
        verdict: verdict(holds),
        evidence: evidence.join(". "),
    }
}

fn one_row_off(report: &MappingReport) -> Claim {
    let rows = || {
        report.pair_errors.iter().filter(|row| {
            matches!(
                row.variant,
                Variant::Closed { root, discriminant: Discriminant::Float, corrected: false }
                    if !matches!(root, Root::Newton(_, Steps::One))
            )
        })
    };
    let worst = rows().max_by_key(|row| row.largest_row_error());
    Claim {
        place: "§3.3",
        claim: "a wrong root puts a thread into the row before or after its own",
        verdict: verdict(worst.map(|row| row.largest_row_error() <= 1)),
        evidence: worst.map_or_else(String::new, |row| {
            let (off, n) = (row.largest_row_error(), row.n);
            format!("two steps and more: up to {off} rows ({}, {n} boxes)", row.variant)
        }),
    }
}

fn fourth_step(report: &MappingReport) -> Claim {
    let percent = |processor, steps, count| {
        let root = Root::Newton(Magic::Carmack, steps);
        let of_it = |row: &&RootErrorRow| {
            (row.processor, row.root, row.tally.count) == (processor, root, count)
        };
        report.root_errors.iter().find(of_it).map(RootErrorRow::percent)
    };
    let largest = report.root_errors.iter().map(|row| row.tally.count).max().unwrap_or(0);
    let mut same = None;
    let mut parts = Vec::new();
    for processor in [Processor::Cpu, Processor::Gpu] {
        let three = percent(processor, Steps::Three, largest);
        let four = percent(processor, Steps::Four, largest);
        if let (Some(three), Some(four)) = (three, four) {
            same = Some(same.unwrap_or(true) && (three - four).abs() < 1e-4);
            parts.push(format!("{processor}: {three:.4} % with three, {four:.4} % with four"));
        }
    }
    Claim {
        place: "table 3",
        claim: "a fourth step changes nothing",
        verdict: verdict(same),
        evidence: format!("{largest} roots, {}", parts.join("; ")),
    }
}

fn newton_faster(report: &MappingReport) -> Claim {
    let count = report.root_times.iter().filter(|row| row.processor == Processor::Gpu);
    let count = count.filter(|row| row.ms.is_some()).map(|row| row.count).max();
    let ms = |root| {
        let rows = report.root_times.iter();
        let of_it = rows.filter(|row| row.processor == Processor::Gpu && row.root == root);
        of_it.filter(|row| Some(row.count) == count).find_map(|row| row.ms)
    };
    let built_in = ms(Root::BuiltIn);
    let one = ms(Root::Newton(Magic::Carmack, Steps::One));
    let two = ms(Root::Newton(Magic::Carmack, Steps::Two));
    let (holds, evidence) = match (count, built_in, one, two) {
        (Some(count), Some(built_in), Some(one), Some(two)) => (
            Some(two < built_in),
            format!("{count} roots: built in {built_in:.3} ms, one step {one:.3}, two {two:.3}"),
        ),
        _ => (None, String::new()),
    };
    Claim {
        place: "table 4",
        claim: "the approximated root is 13 % faster than the GPU's own",
        verdict: verdict(holds),
        evidence,
    }
}

/// Time of the paper's way and of the lazy way at the largest size that has both.
fn with_and_without(report: &MappingReport, processor: Processor) -> Option<(u32, f64, f64)> {
    let ms = |variant, n| {
        let of_it =
            |row: &&MapTimeRow| (row.processor, row.variant, row.n) == (processor, variant, n);
        report.map_times.iter().find(of_it).and_then(|row| row.ms)
    };
    let mut sizes: Vec<u32> = report.map_times.iter().map(|row| row.n).collect();
    sizes.sort_unstable();
    let both = |n| Some((n, ms(PAPERS_OWN, n)?, ms(Variant::Lazy, n)?));
    sizes.into_iter().rev().find_map(both)
}

fn lazy_slower_on_gpus(report: &MappingReport) -> Claim {
    let times = with_and_without(report, Processor::Gpu);
    Claim {
        place: "table 2",
        claim: "on a GPU the lazy way takes nearly twice as long",
        verdict: verdict(times.map(|(_, with_root, lazy)| lazy > 1.5 * with_root)),
        evidence: times.map_or_else(String::new, |(n, with_root, lazy)| {
            format!("{n} boxes: closed form {with_root:.3} ms, lazy {lazy:.3} ms")
        }),
    }
}

fn lazy_faster_on_cpus(report: &MappingReport) -> Claim {
    let times = with_and_without(report, Processor::CpuThread);
    Claim {
        place: "§3.2.2",
        claim: "on one CPU thread the lazy way is four times faster",
        verdict: verdict(times.map(|(_, with_root, lazy)| lazy < 0.5 * with_root)),
        evidence: times.map_or_else(String::new, |(n, with_root, lazy)| {
            format!("{n} boxes: closed form {with_root:.1} ms, lazy {lazy:.1} ms")
        }),
    }
}

/// Byte and bit rows of the largest size, written in the paper's way.
fn byte_and_bit(report: &MappingReport) -> Option<[&OutputRow; 2]> {
    let row = |bits| {
        let rows = report.outputs.iter().filter(move |row| row.bits_per_pair == bits);
        rows.filter(|row| row.thread_a_pair).max_by_key(|row| row.n)
    };
    Some([row(8)?, row(1)?])
}

fn kernel_same_for_bits(report: &MappingReport) -> Claim {
    let rows = byte_and_bit(report);
    Claim {
        place: "table 5",
        claim: "the kernel takes as long with one bit a pair as with one byte",
        verdict: verdict(
            rows.map(|[byte, bit]| (bit.kernel_ms / byte.kernel_ms - 1.0).abs() < 0.1),
        ),
        evidence: rows.map_or_else(String::new, |[byte, bit]| {
            let (n, byte, bit) = (byte.n, byte.kernel_ms, bit.kernel_ms);
            format!("{n} boxes: byte {byte:.4} ms, bit {bit:.4} ms")
        }),
    }
}

fn transfer_smaller_for_bits(report: &MappingReport) -> Claim {
    let rows = byte_and_bit(report);
    Claim {
        place: "table 5",
        claim: "one bit a pair comes back about eight times faster",
        verdict: verdict(rows.map(|[byte, bit]| byte.transfer_us > 5.0 * bit.transfer_us)),
        evidence: rows.map_or_else(String::new, |[byte, bit]| {
            let (n, byte, bit) = (byte.n, byte.transfer_us, bit.transfer_us);
            format!("{n} boxes: byte {byte:.1} µs, bit {bit:.1} µs")
        }),
    }
}
