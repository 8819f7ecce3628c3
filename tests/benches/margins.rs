//! Scenes whose boxes have margins beside plain ones: what it costs to set all boxes, by how many leave.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench margins [-- --n 10000,100000] [--frames 20]
//! ```
//!
//! In process. All boxes are set in each frame: they jitter within their margin, and the share of the
//! column `leave` teleports. A frame is the edit and its changes, visited and taken. Each row has the median
//! frame of a plain scene, of near pairs and of exact pairs, in turns; `ns a box` is that of exact pairs,
//! `sent` what that sends a frame, `bytes` what this process keeps of it, a box, and of the plain scene.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use pairmask::scene::{SceneOptions, Want};
use pairmask::{Aabb, Backend, EndedList, Margin, MarginedPairs, PairList, Session};
use pairmaskd::scene::{Random, Scene, SceneName};

/// Frames that are not counted: cells are built, memory is taken.
const WARM_UP: usize = 3;
/// Margin and jitter, of an edge of the scene's first box.
const MARGIN: f32 = 0.1;
const JITTER: f32 = 0.05;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut sizes, mut frames) = (vec![10_000, 100_000], 20);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(flag) = args.next() {
        let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?;
        match flag.as_str() {
            "--n" => sizes = value.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--frames" => frames = value.parse::<usize>()?.max(1),
            _ => return Err(format!("unknown argument {flag}").into()),
        }
    }
    println!(
        "{:>8} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9} {:>12}",
        "boxes", "leave %", "plain µs", "near µs", "exact µs", "ns a box", "sent", "bytes"
    );
    for n in sizes {
        for percent in [0.0, 0.02, 1.0, 10.0] {
            row(n, percent, frames)?;
        }
    }
    Ok(())
}

fn row(n: usize, percent: f64, frames: usize) -> Result<(), Box<dyn Error>> {
    let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    let options = SceneOptions::default();
    let mut plain = session.scene(options);
    let mut near = session.margined_scene(options, MarginedPairs::Near);
    let mut exact = session.margined_scene(options, MarginedPairs::Exact);
    let home = Scene::new(SceneName::Uniform, n, 1).boxes().to_vec();
    let edge = home.first().map_or(1.0, |b| b.max[0] - b.min[0]);
    let margin = Margin::new(MARGIN * edge)?;
    let (mut home, mut random) = (home, Random::new(7));
    let leave = (percent / 100.0 * n as f64).round() as usize;
    let mut times = [const { Vec::new() }; 3];
    let mut sent = 0;
    for frame in 0..WARM_UP + frames {
        for _ in 0..leave {
            let [to, from] = [(); 2].map(|()| random.below(n as u64) as usize);
            home[to] = home[from];
        }
        let mut shaken = || JITTER * edge * (random.unit() - 0.5);
        let boxes: Vec<Aabb> = home
            .iter()
            .map(|b| {
                let by = [shaken(), shaken(), shaken()];
                let moved = |corner: [f32; 3]| std::array::from_fn(|x| corner[x] + by[x]);
                Aabb { min: moved(b.min), max: moved(b.max) }
            })
            .collect();
        let all = 0..n as u32;
        let begun = Instant::now();
        let answer = plain.edit().set_all(all.clone(), &boxes).commit(Want::Changes)?.take();
        visit(answer.begun(), answer.ended(), answer.pairs());
        drop(answer);
        let mut took = [begun.elapsed().as_secs_f64() * 1e6, 0.0, 0.0];
        let before = exact.stats().sent;
        for (scene, took) in [&mut near, &mut exact].into_iter().zip(&mut took[1..]) {
            let begun = Instant::now();
            let edit = scene.edit().set_all(all.clone(), &boxes, margin);
            let answer = edit.commit(Want::Changes)?.take();
            visit(answer.begun(), answer.ended(), answer.pairs());
            drop(answer);
            *took = begun.elapsed().as_secs_f64() * 1e6;
        }
        if frame >= WARM_UP {
            sent += exact.stats().sent - before;
            times.iter_mut().zip(took).for_each(|(times, took)| times.push(took));
        }
    }
    let [plain_us, near_us, exact_us] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    });
    let bytes = [exact.allocated_bytes(), plain.allocated_bytes()].map(|bytes| bytes / n.max(1));
    println!(
        "{n:>8} {percent:>7} {plain_us:>9.0} {near_us:>9.0} {exact_us:>9.0} {:>9.1} {:>9} {:>12}",
        1e3 * exact_us / n as f64,
        sent / frames as u64,
        format!("{} / {}", bytes[0], bytes[1])
    );
    Ok(())
}

/// Reads every pair of an answer.
fn visit(begun: PairList<'_>, ended: EndedList<'_>, pairs: PairList<'_>) {
    let mut sum = 0u64;
    for list in [begun, pairs] {
        list.for_each_slice(|slice| {
            sum += slice.iter().map(|pair| u64::from(pair[1])).sum::<u64>();
        });
    }
    sum += ended.iter().map(|ended| u64::from(ended.pair[0])).sum::<u64>();
    black_box(sum);
}
