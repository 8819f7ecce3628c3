//! Measurements of the GPU's engines, one JSON object a line: times of stages by the GPU's clock, and of frames
//! (boxes in shared memory → mask in shared memory) by the host's. Pairs are compared with those of the CPU.

pub(crate) mod grid;
pub(crate) mod scenes;
pub(crate) mod shared;

use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmask_shaders::RowsPerThread;
use pairmaskd::execute::gpu::user_cache_folder;
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Gpu, GpuChoice, HostImport, Tuning, Upload,
};
use pairmaskd::scene::SceneName;
use serde_json::json;

use crate::{Fault, Result};

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

fn wrong_pairs(n: u32, scene: SceneName) -> Fault {
    format!("{n} boxes of {scene}: the pairs differ from the CPU's").into()
}

/// Measures and prints.
///
/// # Errors
/// Where the GPU fails or is not there, or pairs differ.
pub fn run(options: &BenchOptions, out: &mut dyn Write) -> Result<()> {
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
        for encoding in encodings(n) {
            let mut ways = vec![(true, default.clone())];
            for imported in [true, false] {
                let uploads = uploads(n, imported).iter();
                ways.extend(uploads.map(|upload| {
                    (imported, AllPairsOptions { upload: *upload, ..default.clone() })
                }));
            }
            if options.sweep {
                for rows in RowsPerThread::ALL {
                    ways.extend([1, 2, 4, 8, 16].map(|strip_blocks| {
                        let tuning = Some(Tuning { rows, strip_blocks });
                        (true, AllPairsOptions { tuning, ..default.clone() })
                    }));
                }
            }
            let is_measured = options.measure && (encoding != Encoding::Dense || n <= DENSE_LIMIT);
            let (ways, budget) = if is_measured {
                (&ways[1..], options.budget)
            } else {
                (&ways[..1], Duration::ZERO)
            };
            for (import, with) in ways {
                all_pairs(&gpu, with, *import, n, encoding, (budget, options.check), out)?;
            }
        }
    }
    Ok(())
}

/// Measures the grid and prints.
///
/// # Errors
/// As [`run`].
pub fn run_grid(options: &BenchOptions, out: &mut dyn Write) -> Result<()> {
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

/// Dense masks of more boxes take longer to transfer than to compute: they are checked alone.
const DENSE_LIMIT: u32 = 40_000;

/// Dense masks of more boxes are not even checked: 900 MB. Pair indices leave u32 at 92,683 boxes.
const DENSE_CHECK_LIMIT: u32 = 120_000;

fn encodings(n: u32) -> impl Iterator<Item = Encoding> {
    let dense = (n <= DENSE_CHECK_LIMIT).then_some(Encoding::Dense);
    dense.into_iter().chain([Encoding::Sparse, Encoding::List])
}

/// Measures all pairs in one way, and prints.
fn all_pairs(
    gpu: &Arc<Gpu>,
    with: &AllPairsOptions,
    import: bool,
    n: u32,
    encoding: Encoding,
    (budget, check): (Duration, bool),
    out: &mut dyn Write,
) -> Result<()> {
    let count = BoxCount::new(n);
    let rig = |boxes: &[Aabb], profiled| {
        grid::all_pairs_rig(gpu, with, import, boxes, encoding, profiled)
    };
    let row = grid::measure_with(rig, SceneName::Uniform, n, encoding, budget, check)?;
    let used = with.tuning.unwrap_or_else(|| Tuning::for_frame(count, encoding));
    let pairs_us: f64 = row.stage_us.iter().filter(|(l, _)| l == "pairs").map(|(_, us)| us).sum();
    let line = json!({
        "kind": "all-pairs", "upload": with.upload.map_or("auto".to_owned(), |u| format!("{u:?}")),
        "default_tuning": with.tuning.is_none(), "rows": used.rows as u32,
        "strip_blocks": used.strip_blocks, "pairs_per_s": count.pair_count() as f64 / pairs_us * 1e6,
        "row": row,
    });
    Ok(writeln!(out, "{line}")?)
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
