//! The mapping function study: ways from a thread number k to a pair (a, b), with the time and the
//! errors of each.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments
//! using GPU mapping function", EGPGV 2012, §3: tables 2 to 5 and figure 4. The paper numbers boxes
//! from 1, this crate from 0; k is the same number in both. Ways that the paper does not have
//! (from the far end, integer searches, folding) are measured beside its own.
//!
//! No variant here serves a client. Production uses `pairmask_core::pair_index` on the host, which is
//! proven exact for every n, and integer searches within a band on the GPU (`pack_dense`).

pub mod errors;
pub mod gpu;
pub mod stage;
pub mod times;
pub mod variants;

#[cfg(test)]
mod tests;

use std::time::Duration;

use pairmask_core::BoxCount;
use pairmaskd::execute::gpu::{Checks, GpuChoice, GpuError, HostImport};
use pairmaskd::scene::{Scene, SceneName};

use self::errors::Tally;
use self::gpu::{Bench, Ids};
use self::stage::{MappingStage, PAPERS_OWN, ROOT_TIME, Root, TIME, Variant};
use super::harness::{Fields, Part, Plot, Report, Table, machine_with, open_if_any, row};
use super::papers::{self, figure};
use crate::Result;

/// How much is measured: sizes and budgets depend on the machine's kind.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    quick: bool,
    software: bool,
    large: bool,
    /// Runs are repeated for this long, three times at least.
    time: Duration,
    /// A single run on the GPU that is expected to take longer is left out.
    longest_run: Duration,
    /// Most ids that a CPU measurement maps; the time of more is scaled up.
    most_cpu_ids: u64,
}

/// The CPU's processors, and whether all threads take part.
const PROCESSORS: [(&str, bool); 2] = [("cpu_thread", false), ("cpu", true)];
const MANY_THREADS: usize = 8;
/// Numbers whose roots are compared (table 3) or timed (table 4).
const ROOTS: [u32; 7] = [1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000, 1_000_000_000];

impl Plan {
    fn new(quick: bool, software: bool) -> Self {
        let longest_ms = if quick { 50 } else { 2_000 };
        let longest_ms = if software { longest_ms.min(300) } else { longest_ms };
        Self {
            quick,
            software,
            large: rayon::current_num_threads() >= MANY_THREADS,
            time: Duration::from_millis(if quick { 1 } else { 20 }),
            longest_run: Duration::from_millis(longest_ms),
            most_cpu_ids: if quick { 1 << 18 } else { 1 << 24 },
        }
    }

    const fn pick<T: Copy>(&self, quick: T, whole: T) -> T {
        if self.quick { quick } else { whole }
    }
}

/// With `quick` small sizes and few runs, in seconds; times mean little.
pub fn measure(choice: &GpuChoice, quick: bool) -> Result<Report> {
    let gpu = open_if_any(choice, HostImport::Never)?;
    let software = gpu.as_ref().is_some_and(|gpu| gpu.is_software());
    let plan = Plan::new(quick, software);
    let mut bench = gpu.as_ref().map(|gpu| Bench::new(gpu, Checks::Off)).transpose()?;
    let map_times = map_times(&plan, bench.as_mut())?;
    let limit = plan.pick(4_200, if plan.large { 20_000 } else { 13_000 });
    let closed = Variant::all().filter(|variant| matches!(variant, Variant::Closed { .. }));
    let first_wrong = closed.map(|variant| {
        row!(variant: variant.to_string(), n: errors::first_wrong_count(variant, limit), limit)
    });
    let mut report = Report::new("mapping", Vec::new());
    report.section(
        "first_wrong",
        "Numbers of boxes from which a row starts or ends wrongly",
        "By the f32 arithmetic of a CPU (correctly rounded, no fused operations).",
        &first_wrong.collect::<Vec<_>>(),
    );
    report.section(
        "root_errors",
        "Table 3: integer parts of roots that are wrong",
        "Of √1 to √N in f32, against the built-in root of the same processor (`other`) and the exact \
         integer root (`inexact`). The paper says that four steps give the figures of three.",
        &root_errors(&plan, bench.as_mut())?,
    );
    let pair_errors = pair_errors(&plan, bench.as_mut(), &map_times)?;
    report.section(
        "pair_errors",
        "Wrong pairs by number of boxes",
        "Ids that are mapped to another pair or to none, the largest distance from the right row, and \
         shares of pairs that are missed and tested again. Beside a sample, the first and last id of \
         every row are looked at (on the GPU 16 on either side). Ids are counted in the variant's own \
         order (fold, lazy); on the GPU they have 32 bits as long as they fit, then 64.",
        &pair_errors,
    );
    report.section(
        "map_times",
        "Table 2: time to map all ids, ms",
        "With the paper's closed form (`closed sqrt`), the lazy way, and all others. One thread of \
         the GPU takes 32 ids. CPU times past 2^24 ids are scaled up from so many. Where there is no \
         time, it would take longer than the study waits. The paper's kernel tests boxes too, and its \
         times grow as n and not as n², so only the ratio compares.",
        &map_times,
    );
    report.section(
        "root_times",
        "Table 4: time to take roots, ms",
        "The integer parts of √1 to √N, summed. The paper does not say how many steps it timed; \
         its figure stands beside each.",
        &root_times(&plan, bench.as_mut())?,
    );
    let (mut outputs, mut growth) = (Vec::new(), Vec::new());
    if let Some(bench) = &mut bench {
        for &n in plan.pick(&[100, 1_000][..], &[100, 1_000, 5_000, 7_500]) {
            for (thread_a_pair, bits) in [(true, 8), (true, 1), (false, 8), (false, 1)] {
                outputs.extend(mask_row(&plan, bench, n, thread_a_pair, bits)?);
            }
        }
        let all = [100, 500, 1_000, 1_500, 2_000, 2_500, 3_000, 3_500, 4_000, 4_500, 5_000];
        for &n in plan.pick(&all[..3], &all) {
            growth.extend(mask_row(&plan, bench, n, false, 1)?);
        }
    }
    report.section(
        "outputs",
        "Table 5: one byte or one bit a pair",
        "The corrected closed form, keys in video memory, output copied to host memory. As in the \
         paper each thread has one pair and ORs its result into the output; beside it, each thread \
         computes a whole word and no word has two writers. WGSL has no byte stores, so bytes are \
         written four to a word.",
        &outputs,
    );
    report.section(
        "growth",
        "Figure 4: kernel, input and output by number of boxes",
        "One bit a pair, one thread a word. The figure has no numbers; table 5's stand here.",
        &growth,
    );
    let claims = papers::mapping_claims(&report)?;
    let by = ["variant", "n", "processor"];
    let table = Table::of(&pair_errors);
    let plot = Plot::of(&table, "wrong_share", "ps_per_pair", &by);
    let page = vec![
        Part::heading(2, "Time against error"),
        Part::text(
            "Time a pair against the share of numbers that become another pair or none, each of which is \
             a pair missed or tested twice; the dashed line is the front of these two.",
        ),
        Part::Plots(vec![plot.svg()]),
    ];
    report.page = Some(("mapping.html", page));
    // The head and the claims, which are judged by all that follows.
    let sections = std::mem::replace(
        &mut report.parts,
        vec![
            Part::heading(1, "The mapping function: run time against error"),
            Part::text(
                "Avril, Gouranton and Arnaldi, EGPGV 2012, §3, measured again. `paper_` are the paper's \
             figures (Quadro FX 3600M, Core 2 Duo X7900).",
            ),
        ],
    );
    report.machine(machine_with(gpu.as_ref().map(|gpu| gpu.info())));
    report.section("claims", "What holds and what breaks", "", &claims);
    report.parts.extend(sections);
    Ok(report)
}

fn root_errors(plan: &Plan, mut bench: Option<&mut Bench>) -> Result<Vec<Fields>, GpuError> {
    let mut rows = Vec::new();
    for root in Root::all() {
        for &count in plan.pick(&ROOTS[..3], &ROOTS[..6]) {
            let paper_percent = figure(&format!("table_3[count={count}].{root}"));
            let mut push = |processor, tally| {
                rows.push(row!(processor, root: root.to_string(), tally, paper_percent));
            };
            push("cpu", errors::count_roots(root, count.into()));
            let Some(bench) = bench.as_deref_mut() else { continue };
            if let Some(tally) = gpu::count_roots(bench, root, count)? {
                push("gpu", tally);
            }
        }
    }
    Ok(rows)
}

/// The errors of all variants, each beside its time at that number of boxes, where that was measured.
fn pair_errors(
    plan: &Plan,
    mut bench: Option<&mut Bench>,
    times: &[Fields],
) -> Result<Vec<Fields>, GpuError> {
    let mut rows = Vec::new();
    let mut push = |processor, variant: Variant, n, found: (Tally, Fields), row_ends| {
        let ((tally, coverage), row_ends): (_, Option<Tally>) = (found, row_ends);
        // Errors are the same on all threads; the time on one thread is the cost of the arithmetic.
        let timed_on = if processor == "cpu" { "cpu_thread" } else { processor };
        let name = variant.to_string();
        let is_its = |row: &&Fields| {
            row["n"] == n && row["processor"] == timed_on && row["variant"] == name.as_str()
        };
        let ms = times.iter().find(is_its).and_then(|row| row["ms"].as_f64());
        let pairs = BoxCount::new(n).pair_count() as f64;
        let both = row_ends.map_or(tally, |ends| tally.plus(ends));
        let at_row_ends = row_ends.map_or(0.0, |ends| ends.wrong as f64 / pairs);
        rows.push(row!(
            processor,
            variant: name,
            n,
            scope: if row_ends.is_none() { "all" } else { "sample" },
            tally,
            coverage,
            row_ends,
            wrong: both.wrong,
            row_error: both.largest_row_error,
            wrong_share: tally.wrong_share().max(at_row_ends),
            ps_per_pair: ms.map(|ms| ms * 1e9 / pairs),
        ));
    };
    let sample_ids = plan.pick(1 << 14, if plan.large { 1 << 22 } else { 1 << 20 });
    let sample_words = plan.pick(1 << 9, if plan.software { 1 << 12 } else { 1 << 18 });
    // Up to so many boxes every id is counted.
    let on_cpu = plan.pick(1_000, if plan.large { 32_768 } else { 10_000 });
    let on_gpu = plan.pick(1_000, if plan.software { 1_000 } else { 92_682 });
    // k leaves 2^24 at 5,794 boxes, 2^31 at 65,537 and 2^32 at 92,683.
    let counts = plan.pick(
        &[1_000, 4_113, 16_384, 100_000][..],
        &[
            1_000, 3_000, 4_096, 4_113, 10_000, 16_384, 32_768, 65_536, 92_682, 100_000, 300_000,
            1_000_000,
        ],
    );
    for &n in counts {
        log::info!("mapping study: errors, {n} boxes");
        for variant in Variant::all() {
            let boxes = BoxCount::new(n);
            if n <= on_cpu {
                let found = errors::exhaustive(variant, boxes);
                push("cpu", variant, n, found, None);
            } else {
                let tally = errors::sampled(variant, boxes, sample_ids);
                let ends = errors::around_rows(variant, boxes);
                push("cpu", variant, n, (tally, errors::bounded(&tally)), Some(ends));
            }
            let Some(bench) = bench.as_deref_mut() else { continue };
            // The GPU counts in 32 bits.
            let countable = u32::try_from(variant.id_count(n)).is_ok();
            let is_whole = n <= on_gpu && countable;
            let ids = if is_whole { Ids::All } else { Ids::Words(sample_words) };
            let Some(found) = gpu::count(bench, variant, n, ids)? else { continue };
            let ends =
                if is_whole { None } else { gpu::count(bench, variant, n, Ids::AroundRows)? };
            push("gpu", variant, n, found, ends.map(|(tally, _)| tally));
        }
    }
    Ok(rows)
}

fn map_times(plan: &Plan, mut bench: Option<&mut Bench>) -> Result<Vec<Fields>, GpuError> {
    let mut rows = Vec::new();
    for &n in plan.pick(&[1_000][..], &[1_000, 10_000, 100_000]) {
        log::info!("mapping study: times, {n} boxes");
        for variant in Variant::all() {
            let mut push = |processor, ms: Option<f64>, paper_ms: Option<f64>| {
                rows.push(row!(processor, variant: variant.to_string(), n, ms, paper_ms));
            };
            for (processor, on_all) in PROCESSORS {
                push(processor, times::map_all(variant, BoxCount::new(n), on_all, plan), None);
            }
            let Some(bench) = bench.as_deref_mut() else { continue };
            let paper_ms = match variant {
                PAPERS_OWN => figure(&format!("table_2[n={n}].own")),
                Variant::Lazy => figure(&format!("table_2[n={n}].lazy")),
                _ => None,
            };
            let stage = MappingStage::Map(TIME, variant, variant.is_wide(n));
            push("gpu", gpu::ms(bench, stage, n, variant.id_count(n), plan)?, paper_ms);
        }
    }
    Ok(rows)
}

fn root_times(plan: &Plan, mut bench: Option<&mut Bench>) -> Result<Vec<Fields>, GpuError> {
    let mut rows = Vec::new();
    for &count in plan.pick(&ROOTS[3..4], &ROOTS[3..]) {
        for root in Root::all() {
            let mut push = |processor, ms, paper_ms| {
                rows.push(row!(processor, root: root.to_string(), count, ms, paper_ms));
            };
            for (processor, on_all) in PROCESSORS {
                push(processor, Some(times::roots(root, count.into(), on_all, plan)), None);
            }
            let Some(bench) = bench.as_deref_mut() else { continue };
            // The paper does not say how many steps; its code has one.
            let column = if root == Root::BuiltIn { "sqrt" } else { "newton" };
            let paper_ms = figure(&format!("table_4[count={count}].{column}"));
            let stage = MappingStage::Root(ROOT_TIME, root);
            push("gpu", gpu::ms(bench, stage, count, count.into(), plan)?, paper_ms);
        }
    }
    Ok(rows)
}

fn mask_row(
    plan: &Plan,
    bench: &mut Bench,
    n: u32,
    thread_a_pair: bool,
    bits_per_pair: u32,
) -> Result<Option<Fields>, GpuError> {
    let scene = Scene::new(SceneName::Uniform, n as usize, 1);
    let run = gpu::mask(bench, bits_per_pair, thread_a_pair, scene.boxes(), plan)?;
    let paper = |column| figure(&format!("table_5[bits={bits_per_pair},n={n}].{column}"));
    let row = |run: gpu::MaskRun| {
        let [upload_ms, kernel_ms, transfer_ms] = run.ms;
        row!(
            n,
            bits_per_pair,
            thread_a_pair,
            kernel_ms,
            upload_us: upload_ms * 1e3,
            transfer_us: transfer_ms * 1e3,
            input_bytes: run.input_bytes,
            output_bytes: run.output_bytes,
            paper_kernel_ms: paper("kernel_ms"),
            paper_transfer_us: paper("transfer_us"),
        )
    };
    Ok(run.map(row))
}
