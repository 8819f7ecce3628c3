//! Scenes that are flat beside scenes that are not: `cpu-grid` and `cpu-sap`, ms and pairs tested a box.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench axes -- [--n 10000,100000] [--threads 1,2] [--frames 20]
//! ```
//!
//! All scenes have about a pair a box. `uniform`: unit cubes in a cube. `flat`: unit squares in a plane, z
//! from 0 to 1. `thick`: the same, z from somewhere in -10 to 0 to somewhere in 0 to 10, so that every pair
//! overlaps on z. `unlike`: so, too, with ends on z of 0.05 to 55. Scenes take turns; medians.

use std::error::Error;
use std::time::Instant;

use pairmask_core::Aabb;
use pairmask_core::engine::{CullInput, Engine, Grid, HeapReply, SweepAndPrune};
use pairmask_core::units::BoxCount;
use pairmaskd::scene::Random;

/// Frames that are not counted.
const WARM_UP: usize = 3;
const SCENES: [&str; 4] = ["uniform", "flat", "thick", "unlike"];
/// Boxes beyond which the sweep takes minutes.
const SWEEP_MOST: usize = 100_000;

fn scene(name: &str, n: usize, random: &mut Random) -> Vec<Aabb> {
    let side = if name == "uniform" { (4.0 * n as f32).cbrt() } else { (2.0 * n as f32).sqrt() };
    let boxes = (0..n).map(|_| {
        let [x, y, z] = [(); 3].map(|()| random.range(0.0, side));
        let [low, high] = match name {
            "uniform" => [z, z + 1.0],
            "flat" => [0.0, 1.0],
            "thick" => [random.range(-10.0, 0.0), random.range(0.0, 10.0)],
            _ => [-random.range(-3.0, 4.0).exp(), random.range(-3.0, 4.0).exp()],
        };
        Aabb::new([x, y, low], [x + 1.0, y + 1.0, high])
    });
    boxes.collect()
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    times[times.len() / 2]
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut sizes, mut threads, mut frames) = (vec![10_000, 100_000], vec![1, 2], 20);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(flag) = args.next() {
        let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?.replace('_', "");
        let numbers = || value.split(',').map(str::parse).collect::<Result<Vec<usize>, _>>();
        match flag.as_str() {
            "--n" => sizes = numbers()?,
            "--threads" => threads = numbers()?,
            "--frames" => frames = value.parse::<usize>()?.max(1),
            _ => return Err(format!("unknown option {flag}").into()),
        }
    }
    println!(
        "engine    scene           n threads         ms  ingest  execute publish  tests/box pairs/box"
    );
    for &n in &sizes {
        for &threads in &threads {
            let engines: [Box<dyn Engine>; 2] =
                [Box::new(Grid::new()), Box::new(SweepAndPrune::new())];
            for mut engine in engines {
                if engine.name().to_string() == "cpu-sap" && n > SWEEP_MOST {
                    continue;
                }
                let mut random = Random::new(1);
                let scenes = SCENES.map(|name| scene(name, n, &mut random));
                let mut times = SCENES.map(|_| [(); 4].map(|()| Vec::new()));
                let mut facts = [(0.0, 0.0); 4];
                let mut reply = HeapReply::new();
                for frame in 0..WARM_UP + frames {
                    for (i, boxes) in scenes.iter().enumerate() {
                        let start = Instant::now();
                        let input = CullInput::boxes(boxes).threads(threads);
                        let report = engine.cull(&input, &mut reply)?;
                        let took = start.elapsed().as_nanos() as f64;
                        let stages = report.times;
                        if frame >= WARM_UP {
                            let all = [stages.ingest_ns, stages.execute_ns, stages.publish_ns];
                            let all = [took, all[0] as f64, all[1] as f64, all[2] as f64];
                            times[i].iter_mut().zip(all).for_each(|(t, ns)| t.push(ns / 1e6));
                        }
                        let tests = BoxCount::new(n as u32).pair_count() - report.skipped.pairs;
                        facts[i] = (tests as f64 / n as f64, report.pair_count as f64 / n as f64);
                    }
                }
                for (i, name) in SCENES.iter().enumerate() {
                    let [all, ingest, execute, publish] =
                        times[i].each_mut().map(|times| median(times));
                    println!(
                        "{:<9} {name:<9} {n:>7} {threads:>7} {all:>10.3} {ingest:>7.3} {execute:>8.3} {publish:>7.3} {:>10.1} {:>9.2}",
                        engine.name().to_string(),
                        facts[i].0,
                        facts[i].1
                    );
                }
            }
        }
    }
    Ok(())
}
