//! Engines over scenes, sizes and threads: medians over moving frames, engines interleaved.
//!
//! Every frame of a size and scene is culled by all engines and thread counts one after another,
//! and their pair sets are compared by a hash that does not depend on the order of pairs. `B/box` is
//! the scratch that an engine keeps beside boxes and reply.

use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use pairmask_core::engine::EngineTimes;
use pairmask_tests::measure::percentile;
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene, SceneName};

/// Pairs above which a quadratic scene or engine is left out: it would take minutes and show
/// nothing new.
const MOST_TESTS: f64 = 2.0e10;

/// Engines over scenes, sizes and threads.
#[derive(Parser)]
struct Options {
    #[arg(long, value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000])]
    n: Vec<usize>,
    /// Scenes; by default all but those in which most boxes overlap
    #[arg(long, value_delimiter = ',')]
    scene: Vec<SceneName>,
    #[arg(long, value_delimiter = ',', default_value = "cpu-brute,cpu-sap,cpu-grid")]
    engine: Vec<EngineChoice>,
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2])]
    threads: Vec<usize>,
    #[arg(long, default_value_t = 20)]
    frames: usize,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// One engine on one number of threads.
struct Lane {
    engine: Box<dyn Engine>,
    threads: usize,
    pool: rayon::ThreadPool,
    reply: HeapReply,
    total_ns: Vec<u64>,
    times: Vec<EngineTimes>,
    words: u64,
}

/// Whether a case is small enough for an engine that compares all pairs.
fn worthwhile(name: EngineName, n: usize) -> bool {
    let n = n as f64;
    match name {
        EngineName::CpuBrute => n * n / 2.0 < MOST_TESTS / 10.0,
        EngineName::CpuSap => n.powf(5.0 / 3.0) < MOST_TESTS / 10.0,
        _ => true,
    }
}

/// A number that depends on the set of pairs and not on their order.
fn pair_set_hash(n: usize, reply: &[u32], shape: &MaskShape) -> u64 {
    let mask = MaskView::new(BoxCount::new(n as u32), shape, reply).expect("an engine's mask");
    let mut hash = 0u64;
    mask.for_each(|a, b| {
        let key = u64::from(a) << 32 | u64::from(b);
        let mixed = (key ^ key >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = hash.wrapping_add((mixed ^ mixed >> 32).wrapping_mul(0x94d0_49bb_1331_11eb));
    });
    hash
}

fn main() -> ExitCode {
    let mut options = Options::parse();
    if options.scene.is_empty() {
        options.scene = SceneName::ALL.into_iter().filter(|s| !s.is_quadratic()).collect();
    }
    println!(
        "{:>9} {:>9} {:>10} {:>2} {:>10} {:>10} {:>10} {:>10} {:>10} {:>8} {:>7} {:>7} {:>6}",
        "scene",
        "n",
        "engine",
        "t",
        "median µs",
        "least",
        "ingest",
        "execute",
        "publish",
        "pairs/n",
        "B/pair",
        "tests/n",
        "B/box"
    );
    let mut equal = true;
    for &name in &options.scene {
        for &n in &options.n {
            equal &= run(name, n, &options);
        }
    }
    if equal { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs one scene and size. Returns whether all pair sets were equal.
fn run(name: SceneName, n: usize, options: &Options) -> bool {
    let mut lanes = Vec::new();
    for choice in &options.engine {
        let EngineChoice::Only(engine_name) = *choice else { continue };
        for &threads in &options.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let (Ok(engine), Ok(pool)) = (cpu_engine(engine_name, Isa::best()), pool) else {
                continue;
            };
            if worthwhile(engine_name, n) {
                let (total_ns, times) = (Vec::new(), Vec::new());
                lanes.push(Lane {
                    engine,
                    threads,
                    pool,
                    reply: HeapReply::new(),
                    total_ns,
                    times,
                    words: 0,
                });
            }
        }
    }
    let mut scene = Scene::new(name, n, 1);
    let mut last: Option<CullReport> = None;
    let mut equal = true;
    let warm_up = 3;
    for frame in 0..options.frames + warm_up {
        let mut frame_hash = None;
        for lane in &mut lanes {
            let boxes = scene.boxes();
            let (engine, reply) = (&mut lane.engine, &mut lane.reply);
            let (report, elapsed) = lane.pool.install(|| {
                let start = Instant::now();
                let report = engine.cull(&CullInput::boxes(boxes).threads(lane.threads), reply);
                (report, start.elapsed().as_nanos() as u64)
            });
            let report = match report {
                Ok(report) => report,
                Err(error) => {
                    eprintln!("{name} {n} {}: {error}", lane.engine.name());
                    return false;
                }
            };
            if frame >= warm_up {
                lane.total_ns.push(elapsed);
                lane.times.push(report.times);
            }
            lane.words = report.shape.mask_bytes();
            if frame % 10 == 0 {
                let hash = (report.pair_count, pair_set_hash(n, lane.reply.words(), &report.shape));
                if *frame_hash.get_or_insert(hash) != hash {
                    eprintln!("{name} {n}: {} has other pairs", lane.engine.name());
                    equal = false;
                }
            }
            last = Some(report);
        }
        scene.step();
    }
    let pairs = last.map_or(0, |r| r.pair_count);
    for lane in &lanes {
        let stage = |of: fn(&EngineTimes) -> u64, times: &[EngineTimes]| {
            times.iter().map(of).min().unwrap_or(0) as f64 / 1e3
        };
        println!(
            "{:>9} {:>9} {:>10} {:>2} {:>10.1} {:>10.1} {:>10.1} {:>10.1} {:>10.1} {:>8.2} {:>7.1} {:>7.1} {:>6.1}",
            name,
            n,
            lane.engine.name().as_str(),
            lane.threads,
            percentile(&lane.total_ns, 0.5) as f64 / 1e3,
            lane.total_ns.first().copied().unwrap_or(0) as f64 / 1e3,
            stage(|t| t.ingest_ns, &lane.times),
            stage(|t| t.execute_ns, &lane.times),
            stage(|t| t.publish_ns, &lane.times),
            pairs as f64 / n as f64,
            lane.words as f64 / pairs.max(1) as f64,
            last.map_or(0.0, |r| {
                (n as f64 * (n as f64 - 1.0) / 2.0 - r.skipped.pairs as f64) / n as f64
            }),
            lane.engine.scratch_bytes() as f64 / n as f64,
        );
    }
    equal
}
