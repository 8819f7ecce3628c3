//! `cpu-brute`: median time of a frame by scene, size, instruction set, encoding and threads.
//!
//! `cargo bench -p pairmask-tests --bench brute_force [-- FILTER]`: a filter such as `1000 avx512`
//! keeps the rows that contain all of its words.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask_core::engine::{BruteForce, CullInput, CullReport, Engine, HeapReply, Isa};
use pairmask_core::units::BoxCount;
use pairmask_core::{Aabb, Encoding};
use pairmask_tests::stress_scenes;
use rayon::ThreadPoolBuilder;

/// Numbers of boxes.
const SIZES: [u32; 6] = [64, 256, 1000, 4096, 10_000, 32_768];

/// Scenes, by their names in the stress set.
const SCENES: [&str; 4] = ["uniform", "clustered", "ground plane", "infinite"];

/// Largest scene in which a fixed share of all pairs overlaps.
const QUADRATIC_LIMIT: u32 = 10_000;

/// Time spent on each row of the table.
const ROW_TIME: Duration = Duration::from_millis(60);

/// Frames that bring caches, scratch and clocks to their steady state.
const WARM_UP: usize = 5;

fn main() {
    let filter: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    println!(
        "{:<13} {:>6} {:<9} {:<7} {:<2}  {:>12} {:>12} {:>12}  {:>8} {:>9}  {:>10}",
        "scene",
        "n",
        "isa",
        "mask",
        "t",
        "median ns",
        "ingest ns",
        "best ns",
        "Gpair/s",
        "skipped",
        "pairs"
    );
    for name in SCENES {
        let scene = stress_scenes::ALL.iter().find(|s| s.name() == name).expect("it is listed");
        for n in SIZES {
            if scene.overlaps() == stress_scenes::Overlaps::Quadratic && n > QUADRATIC_LIMIT {
                continue;
            }
            let boxes = scene.boxes(n, 1);
            for isa in Isa::ALL {
                let Ok(mut engine) = BruteForce::with_isa(isa) else { continue };
                for encoding in [Encoding::Dense, Encoding::Sparse] {
                    for threads in [1, 2] {
                        let head = format!(
                            "{name:<13} {n:>6} {:<9} {:<7} t{threads}",
                            isa.as_str(),
                            encoding.as_str()
                        );
                        if filter.iter().all(|word| head.contains(word.as_str())) {
                            println!("{head}  {}", row(&mut engine, &boxes, encoding, threads));
                        }
                    }
                }
            }
        }
    }
}

fn row(engine: &mut BruteForce, boxes: &[Aabb], encoding: Encoding, threads: usize) -> String {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| {
        let mut reply = HeapReply::new();
        let mut frame = || -> (u64, CullReport) {
            let start = Instant::now();
            let report = engine
                .cull(
                    &CullInput::boxes(black_box(boxes)).encoding(encoding).threads(threads),
                    &mut reply,
                )
                .expect("memory");
            black_box(reply.words());
            (start.elapsed().as_nanos() as u64, report)
        };
        for _ in 0..WARM_UP {
            frame();
        }
        let mut frames = Vec::new();
        let start = Instant::now();
        while start.elapsed() < ROW_TIME || frames.len() < 5 {
            frames.push(frame());
        }
        frames.sort_by_key(|(ns, _)| *ns);
        let (median, report) = frames[frames.len() / 2];
        let (best, _) = frames[0];
        let all_pairs = BoxCount::new(boxes.len() as u32).pair_count();
        format!(
            "{median:>12} {:>12} {best:>12}  {:>8.2} {:>8.2}%  {:>10}",
            report.times.ingest_ns,
            all_pairs as f64 / median as f64,
            100.0 * report.skipped.pairs as f64 / all_pairs as f64,
            report.pair_count
        )
    })
}
