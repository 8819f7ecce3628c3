//! Table 5, Figures 3 and 4: one byte or one bit a pair, and what crosses the link.

use crate::study::mapping::paper as paper_of;
use crate::study::mapping::stage::PairOutput;
use crate::study::papers::model::{Claim, Item, Question, Row};
use crate::study::papers::records::{Figures, on_gpus};
use crate::study::papers::rule::Rule;
use crate::study::papers::shapes::{Growth, Mapping, Output};

/// Boxes of table 5.
const COUNTS: [u32; 4] = [100, 1_000, 5_000, 7_500];
/// Boxes of figure 4, first and last, and between.
const GROWTH_COUNTS: [u32; 4] = [100, 1_000, 3_000, 5_000];
/// Part of the kernel's time that is negligible: less than what two runs differ by.
const NEGLIGIBLE: f64 = 10.0;

const MISSING: &str = "no GPU was measured with these numbers of boxes";

/// Written as the paper does: a thread a pair, bits by OR.
fn of_ours(mapping: Option<&Mapping>, output: PairOutput, n: u32) -> Option<&Output> {
    let bits = 32 / output.pairs_per_word();
    let mut rows = mapping?.outputs.iter();
    rows.find(|row| row.n == n && row.bits_per_pair == bits && row.thread_a_pair)
}

fn ask<const N: usize>(
    figures: &Figures,
    claim: &'static str,
    rule: Rule,
    counts: [u32; N],
    row: impl Fn(Option<&Mapping>, u32) -> Row,
) -> Claim {
    Question { claim, rule, missing: MISSING, note: "" }
        .ask(on_gpus(&figures.mapping), |mapping| counts.map(|n| row(mapping, n)).into())
}

/// The byte's figure over the bit's.
fn byte_over_bit<T>(
    of: impl Fn(PairOutput) -> Option<T>,
    figure: impl Fn(T) -> f64,
) -> Option<f64> {
    Some(figure(of(PairOutput::Byte)?) / figure(of(PairOutput::Bit)?))
}

/// Table 5: kernel and transfer with one byte and one bit a pair.
pub fn table_5(figures: &Figures) -> Item {
    let mut claims = Vec::new();
    for (output, kernel, transfer) in [
        (
            PairOutput::Byte,
            "with a byte the kernel is done in the paper's time",
            "with a byte the output is back in the paper's time",
        ),
        (
            PairOutput::Bit,
            "with a bit the kernel is done in the paper's time",
            "with a bit the output is back in the paper's time",
        ),
    ] {
        claims.push(ask(figures, kernel, Rule::NoMore, COUNTS, |mapping, n| {
            let paper = paper_of::table_5(output, n).map(|(ms, _)| ms);
            let ours = of_ours(mapping, output, n).map(|row| row.kernel_ms);
            Row::new(format!("{n} boxes"), "ms", paper, ours)
        }));
        claims.push(ask(figures, transfer, Rule::NoMore, COUNTS, |mapping, n| {
            let paper = paper_of::table_5(output, n).map(|(_, us)| us);
            let ours = of_ours(mapping, output, n).map(|row| row.transfer_us);
            Row::new(format!("{n} boxes"), "µs", paper, ours)
        }));
    }
    claims.push(ask(
        figures,
        "the output is longer on its way with a byte, by as much",
        Rule::Reaches,
        COUNTS,
        |mapping, n| {
            let paper = byte_over_bit(|output| paper_of::table_5(output, n), |(_, us)| us);
            let ours = byte_over_bit(|output| of_ours(mapping, output, n), |row| row.transfer_us);
            Row::new(format!("{n} boxes, byte over bit"), "times", paper, ours)
        },
    ));
    Item::new("Table 5", "kernel and output with one byte and one bit a pair", claims)
}

/// Figure 3: the same figures as a plot.
pub fn figure_3(figures: &Figures) -> Item {
    let kernel = ask(
        figures,
        "the kernel takes exactly as long with a byte as with a bit",
        Rule::SameShare,
        COUNTS,
        |mapping, n| {
            let paper = byte_over_bit(|output| paper_of::table_5(output, n), |(ms, _)| ms);
            let ours = byte_over_bit(|output| of_ours(mapping, output, n), |row| row.kernel_ms);
            Row::new(format!("{n} boxes, byte over bit"), "times", paper, ours)
        },
    );
    let output = ask(
        figures,
        "the output is significantly longer on its way with a byte",
        Rule::AtLeast(1.0),
        COUNTS,
        |mapping, n| {
            let paper = byte_over_bit(|output| paper_of::table_5(output, n), |(_, us)| us);
            let ours = byte_over_bit(|output| of_ours(mapping, output, n), |row| row.transfer_us);
            Row::new(format!("{n} boxes, byte over bit"), "times", paper, ours)
        },
    );
    Item::new("Figure 3", "Table 5 as a plot", vec![kernel, output])
}

fn growth(mapping: Option<&Mapping>, n: u32) -> Option<&Growth> {
    mapping?.growth.iter().find(|row| row.n == n)
}

/// Figure 4: kernel, input and output by the number of objects.
pub fn figure_4(figures: &Figures) -> Item {
    let negligible = ask(
        figures,
        "the transfers are negligible against the kernel",
        Rule::AtMost(NEGLIGIBLE),
        GROWTH_COUNTS,
        |mapping, n| {
            let percent =
                |row: &Growth| (row.upload_us + row.transfer_us) / row.kernel_ms / 1e3 * 100.0;
            let what = format!("{n} boxes, both transfers of the kernel's time");
            Row::new(what, "%", None, growth(mapping, n).map(percent))
        },
    );
    let linear =
        ask(figures, "the input grows linearly", Rule::IsConstant, GROWTH_COUNTS, |mapping, n| {
            let ours = growth(mapping, n).map(|row| row.input_bytes as f64 / f64::from(n));
            Row::new(format!("{n} boxes, input a box"), "bytes", 24.0, ours)
        });
    let larger = ask(
        figures,
        "the output is larger than the input",
        Rule::AtLeast(1.0),
        // A bit a pair is more than 24 bytes a box from 386 boxes on.
        [1_000, 3_000, 5_000],
        |mapping, n| {
            let ours =
                growth(mapping, n).map(|row| row.output_bytes as f64 / row.input_bytes as f64);
            Row::new(format!("{n} boxes, output over input"), "times", None, ours)
        },
    );
    Item::new(
        "Figure 4",
        "kernel, input and output by number of objects",
        vec![negligible, linear, larger],
    )
}
