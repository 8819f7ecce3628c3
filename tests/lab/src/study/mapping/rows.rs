//! The figures of a study, each with the paper's beside it.

use std::fmt;

use pairmask_core::{Aabb, BoxCount};
use serde::{Serialize, Serializer};

use super::cpu_times::{self, Threads};
use super::errors::{self, Coverage, Tally};
use super::gpu::errors::Ids;
use super::gpu::masks::Writer;
use super::gpu::{self, Bench};
use super::plan::Plan;
use super::root_errors::{self, RootTally};
use super::{MappingError, MappingReport, claims, paper};
use crate::gpu_stages::uniform;
use crate::study::machine::Machine;
use crate::study::mapping::stage::{Discriminant, PairOutput, Root, Variant};

/// The processor that computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Processor {
    /// One thread of the CPU.
    CpuThread,
    /// All threads of the CPU.
    Cpu,
    /// The GPU.
    Gpu,
}

impl fmt::Display for Processor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::CpuThread => "cpu, one thread",
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        })
    }
}

fn as_text<T: fmt::Display, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

/// Table 3: wrong integer parts of a root.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RootErrorRow {
    /// Who.
    pub processor: Processor,
    /// The root.
    #[serde(serialize_with = "as_text")]
    pub root: Root,
    /// The counts.
    pub tally: RootTally,
    /// The paper's percentage.
    pub paper_percent: Option<f64>,
}

impl RootErrorRow {
    /// Percentage of integer parts that are not the built-in root's.
    pub fn percent(&self) -> f64 {
        100.0 * self.tally.other as f64 / self.tally.count.max(1) as f64
    }
}

/// The ids that an error row checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Every id.
    All,
    /// A sample, spread evenly.
    Sample,
}

/// The errors of a variant for n boxes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PairErrorRow {
    /// Who.
    pub processor: Processor,
    /// The variant.
    #[serde(serialize_with = "as_text")]
    pub variant: Variant,
    /// Boxes.
    pub n: u32,
    /// The ids of `tally`.
    pub scope: Scope,
    /// The counts.
    pub tally: Tally,
    /// Pairs missed and repeated.
    pub coverage: Coverage,
    /// The counts at the start and end of every row, where errors begin.
    pub row_ends: Option<Tally>,
}

impl PairErrorRow {
    /// Whether any checked id is wrong.
    pub fn is_wrong(&self) -> bool {
        self.tally.wrong > 0 || self.row_ends.is_some_and(|tally| tally.wrong > 0)
    }

    /// Largest distance of a wrong id's row from its own.
    pub fn largest_row_error(&self) -> u64 {
        self.tally.largest_row_error.max(self.row_ends.map_or(0, |tally| tally.largest_row_error))
    }
}

/// Fewest boxes for which a closed form is wrong, by the mirror.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct FirstWrongRow {
    /// The variant.
    #[serde(serialize_with = "as_text")]
    pub variant: Variant,
    /// Fewest boxes; `None` if there are none up to `limit`.
    pub n: Option<u32>,
    /// Largest number of boxes that was checked.
    pub limit: u32,
}

/// Table 2 and beyond: the time to map all ids of n boxes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MapTimeRow {
    /// Who.
    pub processor: Processor,
    /// The variant.
    #[serde(serialize_with = "as_text")]
    pub variant: Variant,
    /// Boxes.
    pub n: u32,
    /// Time in ms; `None` where it was beyond the budget or the device.
    pub ms: Option<f64>,
    /// The paper's.
    pub paper_ms: Option<f64>,
}

impl MapTimeRow {
    /// Picoseconds for each pair, so that ways with a different number of ids compare.
    pub fn ps_per_pair(&self) -> Option<f64> {
        Some(self.ms? * 1e9 / BoxCount::new(self.n).pair_count() as f64)
    }
}

/// Table 4: the time to take roots.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RootTimeRow {
    /// Who.
    pub processor: Processor,
    /// The root.
    #[serde(serialize_with = "as_text")]
    pub root: Root,
    /// Roots.
    pub count: u64,
    /// Time in ms; `None` where it was beyond the budget.
    pub ms: Option<f64>,
    /// The paper's.
    pub paper_ms: Option<f64>,
}

/// Table 5: one byte or one bit a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OutputRow {
    /// Boxes.
    pub n: u32,
    /// Bits of a pair: 8 or 1.
    pub bits_per_pair: u32,
    /// Whether each thread computes one pair and ORs it in, as in the paper.
    pub thread_a_pair: bool,
    /// Kernel in ms.
    pub kernel_ms: f64,
    /// Transfer to the host in µs.
    pub transfer_us: f64,
    /// Bytes transferred.
    pub output_bytes: u64,
    /// The paper's kernel in ms.
    pub paper_kernel_ms: Option<f64>,
    /// The paper's transfer in µs.
    pub paper_transfer_us: Option<f64>,
}

/// Figure 4: kernel time, input and output by n, one bit a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GrowthRow {
    /// Boxes.
    pub n: u32,
    /// Kernel in ms.
    pub kernel_ms: f64,
    /// Upload of the boxes in µs.
    pub upload_us: f64,
    /// Download of the mask in µs.
    pub transfer_us: f64,
    /// 24 bytes a box, as in the paper.
    pub input_bytes: u64,
    /// One bit a pair, in whole words.
    pub output_bytes: u64,
    /// The paper's kernel in ms, where table 5 gives it: the figure has no numbers.
    pub paper_kernel_ms: Option<f64>,
}

/// Measures everything of the plan.
pub(super) fn measure(
    machine: Machine,
    plan: &Plan,
    mut bench: Option<Bench>,
) -> Result<MappingReport, MappingError> {
    let mut report = MappingReport {
        machine,
        claims: Vec::new(),
        root_errors: root_errors(plan, bench.as_mut())?,
        pair_errors: pair_errors(plan, bench.as_mut())?,
        first_wrong: first_wrong(plan),
        map_times: map_times(plan, bench.as_mut())?,
        root_times: root_times(plan, bench.as_mut())?,
        outputs: Vec::new(),
        growth: Vec::new(),
    };
    if let Some(bench) = &mut bench {
        report.outputs = outputs(plan, bench)?;
        report.growth = growth(plan, bench)?;
    }
    report.claims = claims::judge(&report);
    Ok(report)
}

fn root_errors(
    plan: &Plan,
    mut bench: Option<&mut Bench>,
) -> Result<Vec<RootErrorRow>, MappingError> {
    let mut rows = Vec::new();
    for root in Root::all() {
        for &count in &plan.root_counts {
            let paper_percent = paper::table_3(root, count);
            let tally = root_errors::count(root, count);
            rows.push(RootErrorRow { processor: Processor::Cpu, root, tally, paper_percent });
            let Some(bench) = bench.as_deref_mut() else { continue };
            if let Some(tally) = gpu::errors::count_roots(bench, root, count as u32)? {
                rows.push(RootErrorRow { processor: Processor::Gpu, root, tally, paper_percent });
            }
        }
    }
    Ok(rows)
}

/// The errors of the plan's variants.
pub(in crate::study) fn pair_errors(
    plan: &Plan,
    mut bench: Option<&mut Bench>,
) -> Result<Vec<PairErrorRow>, MappingError> {
    let mut rows = Vec::new();
    for &n in &plan.error_counts {
        log::info!("mapping study: errors, {n} boxes");
        for &variant in &plan.variants {
            let boxes = BoxCount::new(n);
            let (scope, (tally, coverage)) = if n <= plan.exhaustive_cpu {
                (Scope::All, errors::exhaustive(variant, boxes))
            } else {
                let tally = errors::sampled(variant, boxes, plan.sample_ids);
                (Scope::Sample, (tally, Coverage::bounded(&tally)))
            };
            let row_ends = (scope == Scope::Sample).then(|| errors::around_rows(variant, boxes));
            let processor = Processor::Cpu;
            rows.push(PairErrorRow { processor, variant, n, scope, tally, coverage, row_ends });
            let Some(bench) = bench.as_deref_mut() else { continue };
            // The GPU counts in 32 bits.
            let countable = u32::try_from(variant.id_count(n)).is_ok();
            let (scope, ids) = if n <= plan.exhaustive_gpu && countable {
                (Scope::All, Ids::All)
            } else {
                (Scope::Sample, Ids::Words(plan.sample_words))
            };
            let Some((tally, coverage)) = gpu::errors::count(bench, variant, n, ids)? else {
                continue;
            };
            let row_ends = match scope {
                Scope::All => None,
                Scope::Sample => gpu::errors::count(bench, variant, n, Ids::AroundRows)?,
            };
            let (processor, row_ends) = (Processor::Gpu, row_ends.map(|(tally, _)| tally));
            rows.push(PairErrorRow { processor, variant, n, scope, tally, coverage, row_ends });
        }
    }
    Ok(rows)
}

fn first_wrong(plan: &Plan) -> Vec<FirstWrongRow> {
    let limit = plan.first_wrong_limit;
    Variant::all()
        .filter(|variant| matches!(variant, Variant::Closed { .. }))
        .map(|variant| FirstWrongRow {
            variant,
            n: errors::first_wrong_count(variant, limit),
            limit,
        })
        .collect()
}

/// The paper's way with a square root: its closed form with the built-in one.
pub const PAPERS_OWN: Variant =
    Variant::Closed { root: Root::BuiltIn, discriminant: Discriminant::Float, corrected: false };

/// The times of the plan's variants.
pub(in crate::study) fn map_times(
    plan: &Plan,
    mut bench: Option<&mut Bench>,
) -> Result<Vec<MapTimeRow>, MappingError> {
    let mut rows = Vec::new();
    for &n in &plan.time_counts {
        log::info!("mapping study: times, {n} boxes");
        for &variant in &plan.variants {
            let paper = match variant {
                PAPERS_OWN => paper::table_2(n).map(|(with_sqrt, _)| with_sqrt),
                Variant::Lazy => paper::table_2(n).map(|(_, lazy)| lazy),
                _ => None,
            };
            for (processor, threads) in
                [(Processor::CpuThread, Threads::One), (Processor::Cpu, Threads::All)]
            {
                let ms = cpu_times::map_all(variant, BoxCount::new(n), threads, &plan.cpu);
                rows.push(MapTimeRow { processor, variant, n, ms, paper_ms: None });
            }
            let Some(bench) = bench.as_deref_mut() else { continue };
            let ms = gpu::times::map_all(bench, variant, n, &plan.gpu)?;
            let processor = Processor::Gpu;
            rows.push(MapTimeRow { processor, variant, n, ms, paper_ms: paper });
        }
    }
    Ok(rows)
}

fn root_times(
    plan: &Plan,
    mut bench: Option<&mut Bench>,
) -> Result<Vec<RootTimeRow>, MappingError> {
    let mut rows = Vec::new();
    for &count in &plan.root_time_counts {
        for root in Root::all() {
            for (processor, threads) in
                [(Processor::CpuThread, Threads::One), (Processor::Cpu, Threads::All)]
            {
                let ms = cpu_times::roots(root, count, threads, &plan.cpu);
                rows.push(RootTimeRow { processor, root, count, ms, paper_ms: None });
            }
            let Some(bench) = bench.as_deref_mut() else { continue };
            let ms = gpu::times::roots(bench, root, count as u32, &plan.gpu)?;
            let paper_ms = paper::table_4(root, count);
            rows.push(RootTimeRow { processor: Processor::Gpu, root, count, ms, paper_ms });
        }
    }
    Ok(rows)
}

fn outputs(plan: &Plan, bench: &mut Bench) -> Result<Vec<OutputRow>, MappingError> {
    let mut rows = Vec::new();
    for &n in &plan.output_counts {
        let boxes: Vec<Aabb> = uniform(n);
        for writer in [Writer::ThreadAPair, Writer::ThreadAWord] {
            for output in [PairOutput::Byte, PairOutput::Bit] {
                let Some(run) = gpu::masks::run(bench, output, writer, &boxes, &plan.gpu)? else {
                    continue;
                };
                let paper = paper::table_5(output, n);
                rows.push(OutputRow {
                    n,
                    bits_per_pair: 32 / output.pairs_per_word(),
                    thread_a_pair: writer == Writer::ThreadAPair,
                    kernel_ms: run.kernel_ms,
                    transfer_us: run.transfer_ms * 1e3,
                    output_bytes: run.output_bytes,
                    paper_kernel_ms: paper.map(|(kernel_ms, _)| kernel_ms),
                    paper_transfer_us: paper.map(|(_, transfer_us)| transfer_us),
                });
            }
        }
    }
    Ok(rows)
}

fn growth(plan: &Plan, bench: &mut Bench) -> Result<Vec<GrowthRow>, MappingError> {
    let mut rows = Vec::new();
    for &n in &plan.growth_counts {
        let (output, writer) = (PairOutput::Bit, Writer::ThreadAWord);
        let Some(run) = gpu::masks::run(bench, output, writer, &uniform(n), &plan.gpu)? else {
            continue;
        };
        rows.push(GrowthRow {
            n,
            kernel_ms: run.kernel_ms,
            upload_us: run.upload_ms * 1e3,
            transfer_us: run.transfer_ms * 1e3,
            input_bytes: run.input_bytes,
            output_bytes: run.output_bytes,
            paper_kernel_ms: paper::table_5(output, n).map(|(kernel_ms, _)| kernel_ms),
        });
    }
    Ok(rows)
}
