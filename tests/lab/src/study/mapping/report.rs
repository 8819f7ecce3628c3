//! The report: its JSON, CSV, and Markdown with the paper's figures in brackets.

use std::fmt::Display;

use serde::Serialize;

use super::errors::{Coverage, RootTally};
use super::stage::{Root, Variant};
use super::{
    FirstWrongRow, GrowthRow, MapTimeRow, OutputRow, PairErrorRow, Processor, RootErrorRow,
    RootTimeRow, Scope,
};
use crate::study::harness::Report;
use crate::study::harness::document::Part;
use crate::study::harness::machine::Machine;
use crate::study::harness::table::{Table, number_text};
use crate::study::papers::{self, Verdict};

/// All figures of a study.
#[derive(Clone, Debug, Serialize)]
pub struct MappingReport {
    /// The machine of the study.
    pub machine: Machine,
    /// The paper's claims, judged.
    pub claims: Vec<Claim>,
    /// Table 3.
    pub root_errors: Vec<RootErrorRow>,
    /// Wrong, missed and repeated pairs.
    pub pair_errors: Vec<PairErrorRow>,
    /// Fewest boxes for which a closed form is wrong.
    pub first_wrong: Vec<FirstWrongRow>,
    /// Table 2, with every variant.
    pub map_times: Vec<MapTimeRow>,
    /// Table 4.
    pub root_times: Vec<RootTimeRow>,
    /// Table 5.
    pub outputs: Vec<OutputRow>,
    /// Figure 4.
    pub growth: Vec<GrowthRow>,
}

/// A claim and its verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// Its place in the paper.
    pub place: String,
    /// The claim, paraphrased.
    pub claim: String,
    /// Whether it holds.
    pub verdict: Verdict,
    /// The figures that decided.
    pub evidence: String,
}

impl MappingReport {
    /// Takes the claims as they were judged.
    pub(super) fn judge(&mut self, claims: Vec<(String, papers::Claim)>) {
        let claim = |(place, claim): (_, papers::Claim)| {
            let papers::Claim { says, rule, verdict, why, .. } = claim;
            let evidence = if why.is_empty() { rule } else { format!("{rule}: {why}") };
            Claim { place, claim: says, verdict, evidence }
        };
        self.claims = claims.into_iter().map(claim).collect();
    }

    /// A section for each processor that has rows: a line for each of `lines` and a column for each size.
    fn by_processor<R, L: Display + Copy + PartialEq>(
        (title, note): (&str, &str),
        rows: &[R],
        key: impl Fn(&R) -> (Processor, L, u64),
        lines: &(impl Iterator<Item = L> + Clone),
        cell: impl Fn(&R) -> Option<String>,
    ) -> Vec<Part> {
        let mut sizes: Vec<u64> = rows.iter().map(|row| key(row).2).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let section = |processor: Processor| {
            let cell = |line: L, size: u64| {
                cell(rows.iter().find(|row| key(row) == (processor, line, size))?)
            };
            let table = Table::by_size("", lines.clone(), &sizes, cell);
            Part::section_of(&format!("{title}: {processor}"), note, table)
        };
        [Processor::CpuThread, Processor::Cpu, Processor::Gpu].map(section).concat()
    }
}

impl Report for MappingReport {
    const NAME: &'static str = "mapping";

    fn parts(&self) -> Vec<Part> {
        let of_pairs = |row: &PairErrorRow| (row.processor, row.variant, u64::from(row.n));
        let mut parts = vec![
            Part::heading(1, "The mapping function: run time against error"),
            Part::text(
                "Avril, Gouranton and Arnaldi, EGPGV 2012, §3, measured again. The paper's figures are \
                 in brackets (Quadro FX 3600M, Core 2 Duo X7900).",
            ),
        ];
        parts.extend(self.machine.parts());
        parts.extend(Part::section("What holds and what breaks", "", &self.claims));
        parts.extend(Part::section(
            "Numbers of boxes from which a row starts or ends wrongly",
            "By the f32 arithmetic of a CPU (correctly rounded, no fused operations).",
            &self.first_wrong,
        ));
        parts.extend(Self::by_processor(
            (
                "Table 3, integer parts of roots that are wrong, %",
                "Of √1 to √N in f32, against the built-in root of the same processor; for `sqrt` itself \
                 against the exact integer root. The paper says that four steps give the figures of three.",
            ),
            &self.root_errors,
            |row| (row.processor, row.root, row.tally.count),
            &Root::all(),
            |row| {
                let RootTally { count, other, inexact } = row.tally;
                let wrong = if row.root == Root::BuiltIn { inexact } else { other };
                let percent = 100.0 * wrong as f64 / count.max(1) as f64;
                Some(with_paper(percent, row.paper_percent))
            },
        ));
        parts.extend(Self::by_processor(
            (
                "Wrong pairs by number of boxes",
                "Share of ids that are mapped to another pair or to none, then the largest distance from \
                 the right row. *Sampled* figures carry `~`; beside the sample, the first and last id of \
                 every row are looked at (on the GPU 16 on either side), and where only they are wrong, \
                 their number stands there. Ids are counted in the variant's own order (fold, lazy); in the \
                 GPU's figures ids have 32 bits as long as they fit, then 64.",
            ),
            &self.pair_errors,
            of_pairs,
            &Variant::all(),
            |row| Some(wrong(row)),
        ));
        parts.extend(Self::by_processor(
            (
                "Pairs missed / tests of a pair that was tested before, share of all pairs",
                "`≤` and ranges: bounds from the sample, see `errors::Coverage`.",
            ),
            &self.pair_errors,
            of_pairs,
            &Variant::all(),
            |row| Some(coverage(row)),
        ));
        parts.extend(Self::by_processor(
            (
                "Table 2, time to map all ids, ms",
                "With the paper's closed form (`closed sqrt`), the lazy way, and all others. One thread of \
                 the GPU takes 32 ids. CPU times past 2^24 ids are scaled up from so many. `–` would take \
                 longer than the study waits. The paper's kernel tests boxes too, and its times grow as n \
                 and not as n², so only the ratio compares.",
            ),
            &self.map_times,
            |row| (row.processor, row.variant, u64::from(row.n)),
            &Variant::all(),
            |row| {
                let ps = row.ps_per_pair().map_or_else(String::new, |ps| format!(", {ps:.1} ps/pair"));
                Some(with_paper(row.ms?, row.paper_ms) + &ps)
            },
        ));
        parts.extend(Self::by_processor(
            (
                "Table 4, time to take roots, ms",
                "The integer parts of √1 to √N, summed. The paper does not say how many steps it timed; \
                 its figure stands beside each.",
            ),
            &self.root_times,
            |row| (row.processor, row.root, row.count),
            &Root::all(),
            |row| Some(with_paper(row.ms?, row.paper_ms)),
        ));
        parts.extend(Part::section(
            "Table 5: one byte or one bit a pair",
            "The corrected closed form, keys in video memory, output copied to host memory. As in the \
             paper each thread has one pair and ORs its result into the output; beside it, each thread \
             computes a whole word and no word has two writers. WGSL has no byte stores, so bytes are \
             written four to a word.",
            &self.outputs,
        ));
        parts.extend(Part::section(
            "Figure 4: kernel, input and output by number of boxes",
            "One bit a pair, one thread a word. The figure has no numbers; table 5's stand here.",
            &self.growth,
        ));
        parts
    }

    fn tables(&self) -> Vec<(&'static str, Table)> {
        vec![
            ("table 3", Table::of(&self.root_errors)),
            ("errors", Table::of(&self.pair_errors)),
            ("first wrong", Table::of(&self.first_wrong)),
            ("table 2", Table::of(&self.map_times)),
            ("table 4", Table::of(&self.root_times)),
            ("table 5", Table::of(&self.outputs)),
            ("figure 4", Table::of(&self.growth)),
        ]
    }
}

fn with_paper(figure: f64, paper: Option<f64>) -> String {
    number_text(figure) + &paper.map_or_else(String::new, |paper| format!(" ({paper})"))
}

fn wrong(row: &PairErrorRow) -> String {
    let sampled = if row.scope == Scope::Sample { "~" } else { "" };
    let off = row.row_error;
    match (row.wrong, row.tally.wrong) {
        (0, _) => format!("{sampled}0"),
        (at_ends, 0) => format!("{sampled}0, {at_ends} at row ends, ±{off}"),
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
            let least = if missed_least == missed_most {
                String::new()
            } else {
                format!("{} to ", share(missed_least))
            };
            let ends = row.row_ends.filter(|ends| row.tally.wrong == 0 && ends.wrong > 0);
            let ends =
                ends.map_or_else(String::new, |ends| format!(", ≤{} at row ends", ends.wrong));
            format!("~{least}{}{ends} / ≤{}", share(missed_most), share(repeated_most))
        }
    }
}
