//! Measurements of `gpu-brute`, one JSON object a line.
//!
//! * `device`: what it runs on.
//! * `stages`: median time of each stage by the GPU's clock, and tests a second of `pairs`.
//! * `latency`: boxes in shared memory → mask in shared memory, by the host's clock.
//! * `check`: the mask against `cpu-brute`'s, word for word.

pub mod grid;
pub mod scenes;
pub(crate) mod shared;

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::engine::{BruteForce, CullError, CullInput, CullReport, Engine, HeapReply};
use pairmask_core::mask::MaskShape;
use pairmask_core::scene::{QueryError, SceneError};
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmask_shaders::RowsPerThread;
use pairmaskd::execute::gpu::user_cache_folder;
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Counted, Gpu, GpuChoice, GpuError, HostImport, OpenError, Tuning,
    Upload,
};
use pairmaskd::scene::SceneName;
use serde_json::json;

use self::shared::Segment;

/// Options of a run.
#[derive(Clone, Debug)]
pub struct BenchOptions {
    /// The GPU.
    pub gpu: GpuChoice,
    /// Numbers of boxes.
    pub counts: Vec<u32>,
    /// Time for each measurement; at least [`LEAST_FRAMES`] frames run.
    pub budget: Duration,
    /// Also measure every tile shape.
    pub sweep: bool,
    /// Compare every mask with the CPU's.
    pub check: bool,
    /// Measure; otherwise only check.
    pub measure: bool,
}

impl Default for BenchOptions {
    fn default() -> Self {
        Self {
            gpu: GpuChoice::Auto,
            counts: vec![1000, 4096, 10_000, 32_768],
            budget: Duration::from_millis(500),
            sweep: false,
            check: true,
            measure: true,
        }
    }
}

/// Fewest frames with percentiles.
pub const LEAST_FRAMES: usize = 3;

/// Frames before a measurement starts: memory is touched, clocks are up, frames are recorded.
const WARM_UP_FRAMES: usize = 20;

/// Why the bench failed.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// No GPU.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The engine could not be made.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A frame failed.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// A query of a scene failed.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// An edit of a scene failed.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// No memory, or the output could not be written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The pairs of the GPU's grid are not the CPU's.
    #[error("{n} boxes of {scene}: the pairs differ from the CPU's")]
    WrongPairs {
        /// Boxes.
        n: u32,
        /// Scene.
        scene: SceneName,
    },
    /// The GPU's mask is not the CPU's.
    #[error("{n} boxes, {encoding}: the mask differs from the CPU's")]
    Wrong {
        /// Boxes.
        n: u32,
        /// Encoding.
        encoding: Encoding,
    },
}

/// Measures and prints.
///
/// # Errors
/// [`BenchError`].
pub fn run(options: &BenchOptions, out: &mut dyn Write) -> Result<(), BenchError> {
    let start = Instant::now();
    let gpu = Gpu::open(&options.gpu, HostImport::IfPossible)?;
    let open_ms = ms(start);
    let default =
        AllPairsOptions { cache_folder: user_cache_folder(), ..AllPairsOptions::default() };
    let start = Instant::now();
    drop(AllPairs::new(&gpu, default.clone())?);
    let pipelines_ms = ms(start);
    let start = Instant::now();
    drop(AllPairs::new(&gpu, default.clone())?);
    let pipelines_again_ms = ms(start);
    let (info, limits) = (gpu.info(), gpu.limits());
    let line = json!({
        "kind": "device", "name": info.name, "driver": info.driver, "pci": info.pci_address,
        "software": info.is_software(), "import": limits.import_align_bytes.is_some(),
        "mapped_video_memory": limits.mapped_video_memory,
        "storage_binding_bytes": limits.storage_binding_bytes,
        "storage_offset_align_bytes": limits.storage_offset_align_bytes,
        "open_ms": open_ms, "pipelines_ms": pipelines_ms,
        "pipelines_again_ms": pipelines_again_ms,
    });
    writeln!(out, "{line}")?;
    for &n in &options.counts {
        let boxes = uniform(n);
        if options.check {
            check(&gpu, &boxes, out)?;
        }
        if !options.measure {
            continue;
        }
        stages(&gpu, &boxes, None, options, out)?;
        if options.sweep {
            for rows in RowsPerThread::ALL {
                for strip_blocks in [1, 2, 4, 8, 16] {
                    stages(&gpu, &boxes, Some(Tuning { rows, strip_blocks }), options, out)?;
                }
            }
        }
        for encoding in encodings(n, DENSE_LIMIT) {
            for imported in [true, false] {
                for upload in uploads(n, imported) {
                    let with = AllPairsOptions { upload: *upload, ..default.clone() };
                    latency(&gpu, with, imported, &boxes, encoding, options, out)?;
                }
            }
        }
    }
    Ok(())
}

/// Measures the grid and prints.
///
/// # Errors
/// [`BenchError`].
pub fn run_grid(options: &BenchOptions, out: &mut dyn Write) -> Result<(), BenchError> {
    let gpu = Gpu::open(&options.gpu, HostImport::IfPossible)?;
    for &n in &options.counts {
        for scene in grid::SCENES {
            for encoding in [Encoding::Sparse, Encoding::List] {
                match grid::measure(&gpu, scene, n, encoding, options.budget, options.check) {
                    Ok(row) => {
                        writeln!(out, "{}", serde_json::to_string(&row).unwrap_or_default())?;
                    }
                    Err(error) => writeln!(out, "{scene} {n} {encoding}: {error}")?,
                }
                out.flush()?;
            }
        }
    }
    Ok(())
}

/// Uploads that are measured. Their difference does not show where the pairs take milliseconds.
fn uploads(n: u32, imported: bool) -> &'static [Option<Upload>] {
    const ALL: [Option<Upload>; 4] = [
        None,
        Some(Upload::KernelReads),
        Some(Upload::DmaCopy),
        // Imported boxes are read in place: the CPU copies none.
        Some(Upload::MappedVideo),
    ];
    match (n, imported) {
        (40_000.., _) => &ALL[..1],
        (_, true) => &ALL[..3],
        (_, false) => &ALL,
    }
}

/// Dense masks of more boxes take longer to transfer than to compute.
const DENSE_LIMIT: u32 = 40_000;

/// Dense masks of more boxes are not even checked: 900 MB. Pair indices leave u32 at 92,683 boxes.
const DENSE_CHECK_LIMIT: u32 = 120_000;

fn encodings(n: u32, dense_limit: u32) -> impl Iterator<Item = Encoding> {
    let dense = (n <= dense_limit).then_some(Encoding::Dense);
    dense.into_iter().chain([Encoding::Sparse, Encoding::List])
}

/// An engine with its shared memory.
struct Rig {
    engine: AllPairs,
    boxes: Segment,
    reply: Segment,
    imported: bool,
}

impl Rig {
    fn new(
        gpu: &Arc<Gpu>,
        options: AllPairsOptions,
        import: bool,
        boxes: &[Aabb],
        encoding: Encoding,
    ) -> Result<Self, BenchError> {
        let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
        let capacity = Counted::Sparse.first_capacity(n);
        let words = MaskShape::exact(encoding, n, capacity, false).extent_words();
        let imports = options.imports.clone();
        let mut rig = Self {
            engine: AllPairs::new(gpu, options)?,
            boxes: Segment::new(size_of_val(boxes))?,
            reply: Segment::new(4 * words as usize)?,
            imported: import,
        };
        rig.boxes.write(boxes);
        for segment in [&mut rig.boxes, &mut rig.reply] {
            rig.imported &= import && segment.import(gpu, &imports).is_ok();
        }
        Ok(rig)
    }

    fn frame(&mut self, n: usize, encoding: Encoding) -> Result<CullReport, CullError> {
        self.engine.cull(&CullInput::boxes(self.boxes.boxes(n)).encoding(encoding), &mut self.reply)
    }
}

fn stages(
    gpu: &Arc<Gpu>,
    boxes: &[Aabb],
    tuning: Option<Tuning>,
    options: &BenchOptions,
    out: &mut dyn Write,
) -> Result<(), BenchError> {
    for encoding in encodings(boxes.len() as u32, DENSE_LIMIT) {
        let with = AllPairsOptions { tuning, profiled: true, ..AllPairsOptions::default() };
        let mut rig = Rig::new(gpu, with, true, boxes, encoding)?;
        let mut times: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
        let started = Instant::now();
        let mut frames = 0;
        while frames < LEAST_FRAMES || started.elapsed() < options.budget / 2 {
            rig.frame(boxes.len(), encoding)?;
            let mut frame: BTreeMap<&'static str, f64> = BTreeMap::new();
            for step in rig.engine.step_times() {
                *frame.entry(step.label).or_default() += step.ns / 1000.0;
            }
            for (label, us) in frame {
                times.entry(label).or_default().push(us);
            }
            frames += 1;
        }
        let medians: BTreeMap<_, _> =
            times.into_iter().map(|(label, us)| (label, percentile(us, 50))).collect();
        let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
        let used = tuning.unwrap_or_else(|| Tuning::for_frame(n, encoding));
        let pairs_us = medians.get("pairs").copied().unwrap_or(f64::NAN);
        let line = json!({
            "kind": "stages", "n": n.get(), "encoding": encoding.as_str(),
            "imported": rig.imported, "default_tuning": tuning.is_none(),
            "rows": used.rows as u32, "strip_blocks": used.strip_blocks, "frames": frames,
            "stage_us": medians, "pairs_per_s": n.pair_count() as f64 / pairs_us * 1e6,
        });
        writeln!(out, "{line}")?;
    }
    Ok(())
}

fn latency(
    gpu: &Arc<Gpu>,
    with: AllPairsOptions,
    import: bool,
    boxes: &[Aabb],
    encoding: Encoding,
    options: &BenchOptions,
    out: &mut dyn Write,
) -> Result<(), BenchError> {
    let upload = with.upload;
    let mut rig = Rig::new(gpu, with, import, boxes, encoding)?;
    let mut times = Vec::new();
    let mut report = rig.frame(boxes.len(), encoding)?;
    let started = Instant::now();
    let mut frames = 0;
    let mut warm_up = WARM_UP_FRAMES;
    while times.len() < LEAST_FRAMES || started.elapsed() < options.budget {
        // Frames that take seconds need no warm-up.
        if started.elapsed() > options.budget {
            warm_up = warm_up.min(1);
        }
        // A client writes its boxes in each frame; that is not timed.
        rig.boxes.write(boxes);
        let start = Instant::now();
        report = rig.frame(boxes.len(), encoding)?;
        if frames >= warm_up {
            times.push(start.elapsed().as_secs_f64() * 1e6);
        }
        frames += 1;
    }
    let line = json!({
        "kind": "latency", "n": boxes.len(), "encoding": encoding.as_str(),
        "memory": if rig.imported { "imported" } else { "staged" },
        "upload": upload.map_or("auto".to_owned(), |u| format!("{u:?}")),
        "frames": times.len(), "p50_us": percentile(times.clone(), 50),
        "p99_us": percentile(times, 99), "pairs": report.pair_count,
        "mask_bytes": report.shape.mask_bytes(),
    });
    writeln!(out, "{line}")?;
    Ok(())
}

fn check(gpu: &Arc<Gpu>, boxes: &[Aabb], out: &mut dyn Write) -> Result<(), BenchError> {
    let n = boxes.len() as u32;
    for encoding in encodings(n, DENSE_CHECK_LIMIT) {
        let mut rig = Rig::new(gpu, AllPairsOptions::default(), true, boxes, encoding)?;
        let report = rig.frame(boxes.len(), encoding)?;
        let mut cpu_reply = HeapReply::new();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let cpu = BruteForce::new()
            .cull(&CullInput::boxes(boxes).encoding(encoding).threads(threads), &mut cpu_reply)?;
        let same =
            sections(&report.shape, rig.reply.words()) == sections(&cpu.shape, cpu_reply.words());
        if !same || report.pair_count != cpu.pair_count || report.census != cpu.census {
            return Err(BenchError::Wrong { n, encoding });
        }
        let line = json!({
            "kind": "check", "n": n, "encoding": encoding.as_str(), "imported": rig.imported,
            "same_as_cpu": same, "pairs": report.pair_count,
        });
        writeln!(out, "{line}")?;
    }
    Ok(())
}

/// The words of each section; `None` where one is outside the reply.
fn sections<'a>(shape: &MaskShape, reply: &'a [u32]) -> Vec<Option<&'a [u32]>> {
    shape.spans().map(|span| span.of(reply)).collect()
}

fn percentile(mut values: Vec<f64>, percent: usize) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() * percent / 100).copied().unwrap_or(f64::NAN)
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// Boxes of one size with about as many overlapping pairs as boxes.
pub(crate) fn uniform(n: u32) -> Vec<Aabb> {
    let mut state = 1u64;
    // Two boxes of edge e in a unit cube overlap with probability 8e³: n²/2 · 8e³ = n.
    let edge = (1.0 / (4.0 * f64::from(n.max(1)))).cbrt() as f32;
    let mut unit = || {
        // SplitMix64 (Steele, Lea and Flood 2014).
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u32 << 24) as f32
    };
    (0..n)
        .map(|_| {
            let min = [unit(), unit(), unit()];
            Aabb { min, max: min.map(|x| x + edge) }
        })
        .collect()
}
