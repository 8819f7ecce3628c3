//! Work that is for nothing: how soon answers that fit no reply are refused, and how soon engines end once nobody waits.
//!
//! In process, so that engines alone are measured. A scene is refused from boxes in hand to the error. An engine ends from
//! the moment when another thread lets go of its frame, at some share of the frame's time, to its return.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use pairmask_core::cancel::Wanted;
use pairmask_core::dispatch::SphereEngines;
use pairmask_core::scene::{Scene, cull_between};
use pairmask_tests::measure::percentile;
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene as Drawn, SceneName};

/// The largest reply of a daemon, by default.
const REPLY_BYTES: u64 = 1 << 30;
/// Frames that go before they are let go of are let go of then, at the latest.
const LONGEST: Duration = Duration::from_millis(400);

/// How soon work that is for nothing ends.
#[derive(Parser)]
struct Options {
    #[arg(long, default_value_t = 1_000_000)]
    n: usize,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Frames of each engine that are let go of
    #[arg(long, default_value_t = 40)]
    frames: u32,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Default)]
struct Flag(AtomicBool);

impl Wanted for Flag {
    fn is_wanted(&self) -> bool {
        !self.0.load(Ordering::Relaxed)
    }
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Boxes with their mins in a cube of some edge, of the edge 1.
fn heap(n: usize, edge: f32) -> Vec<Aabb> {
    let mut state = 1u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let mut min = || [(); 3].map(|()| edge * unit());
    (0..n).map(|_| min()).map(|min| Aabb::new(min, min.map(|x| x + 1.0))).collect()
}

fn refusals(n: usize, threads: usize) {
    let infinite = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
    let scenes = [
        ("identical", vec![at(0.0); n]),
        ("near-identical", heap(n, 1e-3)),
        ("pile", heap(n, 5.0)),
        ("infinite", vec![infinite; n]),
    ];
    println!("{n} boxes that fit no reply, {threads} threads: ms to the refusal, MiB of scratch\n");
    println!("| scene | asked | ms | MiB |\n|---|---|---|---|");
    let line = |scene: &str, asked: &str, start: Instant, is_refused: bool, bytes: usize| {
        let took = milliseconds(start.elapsed());
        assert!(is_refused, "{scene}, {asked}: it is answered");
        println!("| {scene} | {asked} | {took:.2} | {} |", bytes >> 20);
    };
    let encodings = [EncodingChoice::Auto, EncodingChoice::Only(Encoding::Sparse)];
    for (name, boxes) in &scenes {
        let engines = EngineName::CPU.map(EngineChoice::Only);
        for engine in [EngineChoice::Auto].into_iter().chain(engines) {
            for encoding in encodings {
                let options = CullOptions {
                    engine,
                    encoding,
                    threads: Some(threads),
                    ..CullOptions::default()
                };
                let (mut engines, mut reply) =
                    (CpuEngines::new(), HeapReply::with_limit_bytes(REPLY_BYTES));
                let start = Instant::now();
                let refused = engines.cull(boxes, &options, &mut reply).is_err();
                let bytes = engines.scratch_bytes() + reply.allocated_bytes();
                line(name, &format!("{engine}, {encoding}"), start, refused, bytes);
            }
        }
        let options = CullOptions { threads: Some(threads), ..CullOptions::default() };
        let mut reply = HeapReply::with_limit_bytes(REPLY_BYTES);
        let start = Instant::now();
        let half = BoxCount::new(n as u32 / 2);
        let refused = cull_between(&mut CpuEngines::new(), boxes, half, &options, &mut reply);
        line(name, "two sets", start, refused.is_err(), reply.allocated_bytes());
        let mut scene = Scene::new(SceneOptions::default().with_threads(threads));
        scene.limit_pairs(REPLY_BYTES / 8);
        let steps = [sets(0..n as u32, boxes)];
        let start = Instant::now();
        let refused = scene.edit(Edit { steps: &steps }, Report::Changes).is_err();
        line(name, "a scene", start, refused, scene.allocated_bytes());
    }
    let spheres = vec![Sphere::new([0.0; 3], 1.0); n];
    let options = CullOptions { threads: Some(threads), ..CullOptions::default() };
    let mut reply = HeapReply::with_limit_bytes(REPLY_BYTES);
    let start = Instant::now();
    let refused = SphereEngines::new().cull(&spheres, &options, &mut reply).is_err();
    line("identical", "spheres", start, refused, reply.allocated_bytes());
}

/// The times from letting go to the end of work, of which some frames are begun.
fn ends(
    frames: u32,
    mut work: impl FnMut(&mut HeapReply) -> Result<(), CullError> + Send,
) -> Vec<Duration> {
    let mut reply = HeapReply::new();
    let flag = Arc::new(Flag::default());
    // As long as a whole frame takes, at the most.
    let whole = time_to_end(&flag, &mut reply, &mut work, LONGEST).0.min(LONGEST);
    let mut times = Vec::new();
    for frame in 0..frames {
        let share = f64::from(frame) / f64::from(frames);
        let (_, after) = time_to_end(&flag, &mut reply, &mut work, whole.mul_f64(share));
        times.extend(after);
    }
    times
}

/// How long work took, and how much of that after it was let go of, where it had not ended.
fn time_to_end(
    flag: &Arc<Flag>,
    reply: &mut HeapReply,
    work: &mut (impl FnMut(&mut HeapReply) -> Result<(), CullError> + Send),
    pause: Duration,
) -> (Duration, Option<Duration>) {
    flag.0.store(false, Ordering::Relaxed);
    reply.set_asker(Some(flag.clone()));
    std::thread::scope(|scope| {
        let start = Instant::now();
        let working = scope.spawn(move || (work(reply), Instant::now()));
        std::thread::sleep(pause);
        let let_go = Instant::now();
        flag.0.store(true, Ordering::Relaxed);
        let (done, end) = working.join().expect("no panic");
        let after = (done == Err(CullError::Cancelled)).then(|| end - let_go);
        (end - start, after)
    })
}

fn main() {
    let Options { n, threads, frames, .. } = Options::parse();
    pool(threads).install(|| refusals(n, threads));
    println!(
        "\n{n} boxes, uniform: ms from letting go to the engine's return, of {frames} frames\n"
    );
    println!("| engine | threads | ended | p50 | p90 | most |\n|---|---|---|---|---|---|");
    let boxes = Drawn::new(SceneName::Uniform, n, 1).boxes().to_vec();
    let spheres: Vec<Sphere> = boxes.iter().map(|b| Sphere::new(b.min, 0.5)).collect();
    let line = |what: &str, threads: usize, mut times: Vec<Duration>| {
        times.sort_unstable();
        let ms: Vec<f64> = times.iter().map(|time| milliseconds(*time)).collect();
        let (p50, p90) = (percentile(&ms, 0.5), percentile(&ms, 0.9));
        let most = ms.last().copied().unwrap_or(0.0);
        println!("| {what} | {threads} | {} | {p50:.2} | {p90:.2} | {most:.2} |", ms.len());
    };
    for threads in [1, threads] {
        let pool = pool(threads);
        for name in EngineName::CPU {
            let mut engine = best_engine(name);
            let input = CullInput::boxes(&boxes).threads(threads);
            let work = |reply: &mut HeapReply| {
                pool.install(|| {
                    engine.cull(&input, reply).map(|report| {
                        black_box(report);
                    })
                })
            };
            line(name.as_str(), threads, ends(frames, work));
        }
        let mut engines = SphereEngines::new();
        let options = CullOptions { threads: Some(threads), ..CullOptions::default() };
        let work = |reply: &mut HeapReply| {
            pool.install(|| {
                engines.cull(&spheres, &options, reply).map(|answer| {
                    black_box(answer);
                })
            })
        };
        line("spheres", threads, ends(frames, work));
    }
}
