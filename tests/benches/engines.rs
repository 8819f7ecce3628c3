//! Engines over scenes, sizes and threads: medians over moving frames, engines interleaved.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench engines -- [--n 1000,10000] [--scene uniform,pile]
//!     [--engine cpu-grid,cpu-brute] [--threads 1,2] [--frames 20]
//! ```
//!
//! Every frame of a size and scene is culled by all engines and thread counts one after another,
//! and their pair sets are compared by a hash that does not depend on the order of pairs. `B/box` is
//! the scratch that an engine keeps beside boxes and reply.

use std::process::ExitCode;
use std::time::Instant;

use pairmask_core::Aabb;
use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::{
    CullInput, CullReport, Engine, EngineName, EngineTimes, HeapReply, Isa, cpu_engine,
};
use pairmask_core::mask::MaskShape;
use pairmask_core::plan::{Calibration, Capabilities, SceneStats, plan};
use pairmaskd::scene::{Scene, SceneName};

/// Pairs above which a quadratic scene or engine is left out: it would take minutes and show
/// nothing new.
const MOST_TESTS: f64 = 2.0e10;

struct Options {
    sizes: Vec<usize>,
    scenes: Vec<SceneName>,
    engines: Vec<EngineName>,
    threads: Vec<usize>,
    frames: usize,
}

impl Options {
    fn parse() -> Result<Self, String> {
        let mut options = Self {
            sizes: vec![1_000, 10_000, 100_000],
            scenes: SceneName::ALL.into_iter().filter(|s| !s.is_quadratic()).collect(),
            engines: EngineName::CPU.into(),
            threads: vec![1, 2],
            frames: 20,
        };
        let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
        while let Some(flag) = args.next() {
            let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?;
            let items = || value.split(',');
            let number = |s: &str| s.replace('_', "").parse::<usize>().map_err(|e| e.to_string());
            match flag.as_str() {
                "--n" => options.sizes = items().map(number).collect::<Result<_, _>>()?,
                "--threads" => options.threads = items().map(number).collect::<Result<_, _>>()?,
                "--frames" => options.frames = number(&value)?,
                "--scene" => {
                    let parse = |s: &str| s.parse().map_err(|e| format!("{e}"));
                    options.scenes = items().map(parse).collect::<Result<_, _>>()?;
                }
                "--engine" => {
                    let find = |s: &str| {
                        let found = EngineName::from_name(s);
                        found.ok_or_else(|| format!("unknown engine '{s}'"))
                    };
                    options.engines = items().map(find).collect::<Result<_, _>>()?;
                }
                _ => return Err(format!("unknown option {flag}")),
            }
        }
        Ok(options)
    }
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
fn pair_set_hash(reply: &[u32], shape: &MaskShape) -> u64 {
    let MaskShape::Sparse { rows, blocks, bits, order } = shape else { return 0 };
    let (Some(rows), Some(blocks), Some(bits)) = (rows.of(reply), blocks.of(reply), bits.of(reply))
    else {
        return 0;
    };
    let order = order.as_ref().and_then(|o| o.of(reply));
    let index = |position: u32| order.map_or(position, |o| o[position as usize]);
    let mut hash = 0u64;
    for ((&row, &block), &bits) in rows.iter().zip(blocks).zip(bits) {
        let a = index(row);
        let mut rest = bits;
        while rest != 0 {
            let b = index(32 * block + rest.trailing_zeros());
            let key = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
            let mixed = (key ^ key >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            hash = hash.wrapping_add((mixed ^ mixed >> 32).wrapping_mul(0x94d0_49bb_1331_11eb));
            rest &= rest - 1;
        }
    }
    hash
}

fn median(values: &mut [u64]) -> u64 {
    values.sort_unstable();
    values.get(values.len() / 2).copied().unwrap_or(0)
}

fn main() -> ExitCode {
    let options = match Options::parse() {
        Ok(options) => options,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    };
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
    for &name in &options.scenes {
        for &n in &options.sizes {
            equal &= run(name, n, &options);
        }
    }
    if equal { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs one scene and size. Returns whether all pair sets were equal.
fn run(name: SceneName, n: usize, options: &Options) -> bool {
    let mut lanes = Vec::new();
    for &engine_name in &options.engines {
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
                let hash = (report.pair_count, pair_set_hash(lane.reply.words(), &report.shape));
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
    for lane in &mut lanes {
        let stage = |of: fn(&EngineTimes) -> u64, times: &[EngineTimes]| {
            times.iter().map(of).min().unwrap_or(0) as f64 / 1e3
        };
        println!(
            "{:>9} {:>9} {:>10} {:>2} {:>10.1} {:>10.1} {:>10.1} {:>10.1} {:>10.1} {:>8.2} {:>7.1} {:>7.1} {:>6.1}",
            name,
            n,
            lane.engine.name().as_str(),
            lane.threads,
            median(&mut lane.total_ns) as f64 / 1e3,
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
    judge_plan(name, n, scene.boxes(), last.map(|r| r.pair_count), &lanes, options);
    equal
}

/// Prints, for each number of threads, what the plan chooses and how that compares with the best.
fn judge_plan(
    name: SceneName,
    n: usize,
    boxes: &[Aabb],
    pairs: Option<u64>,
    lanes: &[Lane],
    options: &Options,
) {
    let start = Instant::now();
    let stats = SceneStats::of(boxes, pairs);
    let calibration = Calibration::built_in(Isa::best());
    for &threads in &options.threads {
        let capabilities = Capabilities { threads, gpu: None };
        let plan = plan(&stats, &capabilities, &calibration, &CullOptions::default());
        let plan_us = start.elapsed().as_nanos() as f64 / 1e3;
        let least = |lane: &Lane| lane.total_ns.iter().min().copied().unwrap_or(u64::MAX) as f64;
        let best = lanes.iter().min_by(|a, b| least(a).total_cmp(&least(b)));
        let same = |l: &&Lane| l.engine.name() == plan.engine && l.threads == plan.threads;
        let (Some(best), Some(chosen)) = (best, lanes.iter().find(same)) else { continue };
        let ratio = least(chosen) / least(best);
        let predicted = plan.candidates.iter().flatten().find(|c| c.engine == plan.engine);
        println!(
            "{name:>9} {n:>9} plan {} on {} threads, {ratio:.2} x the best ({}), predicted {:.1} µs, planned in {plan_us:.1} µs{}",
            plan.engine,
            plan.threads,
            best.engine.name(),
            predicted.map_or(0.0, |c| c.predicted_ns / 1e3),
            if ratio > 1.3 { "  <-- above 1.3" } else { "" },
        );
    }
}
