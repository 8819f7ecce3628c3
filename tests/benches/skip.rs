//! Scenes that persist beside whole frames: what an edit and its changes cost, by how much moves.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench skip -- [--n 10000,100000] [--scene uniform,pile]
//!     [--moving 0,0.1,1,10,100] [--motion drift,jitter,teleport,spawn] [--frames 20] [--json]
//! ```
//!
//! Both are made in process, by one session, in turns, with the threads of this machine: a pool of which
//! the calling thread is one, so that small edits do not wait for another to wake. Edit: the
//! arrays of indices and boxes in, the answer found (`round_trip_ns`); visit: every change read, and the
//! answer taken. The whole frame is written, answered, and every pair of it visited. A ratio below 1 is
//! in favour of the scene. `bytes` are what the scene keeps, a box.

use std::error::Error;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use pairmask::scene::{Indices, SceneOptions, Want};
use pairmask::{Aabb, Backend, Scene, Session};
use pairmask_lab::study::moving::{Motion, World};
use pairmaskd::scene::SceneName;
use serde_json::json;

/// Frames that are not counted: cells are built, memory is taken.
const WARM_UP: usize = 3;
struct Options {
    sizes: Vec<usize>,
    scenes: Vec<SceneName>,
    percents: Vec<f64>,
    motions: Vec<Motion>,
    frames: usize,
    json: bool,
}

impl Options {
    fn parse() -> Result<Self, String> {
        let mut options = Self {
            sizes: vec![10_000, 100_000],
            scenes: vec![SceneName::Uniform, SceneName::Pile],
            percents: vec![0.0, 0.01, 0.1, 1.0, 10.0, 50.0, 100.0],
            motions: vec![Motion::Drift, Motion::Jitter, Motion::Teleport],
            frames: 20,
            json: false,
        };
        let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
        while let Some(flag) = args.next() {
            if flag == "--json" {
                options.json = true;
                continue;
            }
            let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?;
            let items = || value.split(',');
            let number = |s: &str| s.replace('_', "").parse::<usize>().map_err(|e| e.to_string());
            match flag.as_str() {
                "--n" => options.sizes = items().map(number).collect::<Result<_, _>>()?,
                "--frames" => options.frames = number(&value)?.max(1),
                "--scene" => {
                    let parse = |s: &str| s.parse().map_err(|e| format!("{e}"));
                    options.scenes = items().map(parse).collect::<Result<_, _>>()?;
                }
                "--moving" => {
                    let parse = |s: &str| s.parse().map_err(|e| format!("{s}: {e}"));
                    options.percents = items().map(parse).collect::<Result<_, _>>()?;
                }
                "--motion" => {
                    let parse = |s: &str| s.parse().map_err(|e| format!("{e}"));
                    options.motions = items().map(parse).collect::<Result<_, _>>()?;
                }
                _ => return Err(format!("unknown option {flag}")),
            }
        }
        Ok(options)
    }
}

/// Times of a frame, ns.
#[derive(Default)]
struct Times {
    round_trip: Vec<u64>,
    visit: Vec<u64>,
    total: Vec<u64>,
    whole: Vec<u64>,
}

fn at(values: &mut [u64], share: f64) -> u64 {
    values.sort_unstable();
    let place = (values.len().saturating_sub(1) as f64 * share).round() as usize;
    values.get(place).copied().unwrap_or(0)
}

/// An edit of a scene, its changes visited and taken: round trip, visit, and how many changes.
fn edit(
    scene: &mut Scene,
    indices: &[u32],
    boxes: &[Aabb],
    is_spawn: bool,
) -> Result<(u64, u64, usize), Box<dyn Error>> {
    let all = indices.len() == scene.len();
    let these = if all { Indices::from(0..indices.len() as u32) } else { indices.into() };
    let begin = Instant::now();
    let mut edit = scene.edit().set_all(these, boxes);
    if is_spawn {
        edit = edit.remove_all(these);
    }
    let answer = edit.commit(Want::Changes)?;
    let round_trip = begin.elapsed().as_nanos() as u64;
    let told = answer.take();
    let mut sum = 0;
    let mut visit = |pairs: &[[u32; 2]]| {
        sum += pairs.iter().fold(0u64, |sum, [a, b]| sum + u64::from(a ^ b));
    };
    told.begun().for_each_slice(&mut visit);
    told.pairs().for_each_slice(&mut visit);
    sum += told.ended().iter().fold(0u64, |sum, e| sum + u64::from(e.pair[0] ^ e.pair[1]));
    black_box(sum);
    let visit = begin.elapsed().as_nanos() as u64 - round_trip;
    Ok((round_trip, visit, told.begun().len() + told.ended().len()))
}

/// A whole frame, every pair visited: ns, and how many pairs.
fn whole_frame(session: &mut Session, boxes: &[Aabb]) -> Result<(u64, u64), Box<dyn Error>> {
    let begin = Instant::now();
    let mut frame = session.frame(boxes.len())?;
    frame.boxes_mut().copy_from_slice(boxes);
    let mask = frame.submit()?.wait()?;
    let (mut sum, mut count) = (0u64, 0);
    mask.for_each_slice(|pairs| {
        sum = pairs.iter().fold(sum, |sum, [a, b]| sum + u64::from(a ^ b));
        count += pairs.len() as u64;
    });
    black_box(sum);
    Ok((begin.elapsed().as_nanos() as u64, count))
}

fn run() -> Result<(), Box<dyn Error>> {
    let options = Options::parse()?;
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global()?;
    let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    let mut rows = Vec::new();
    if !options.json {
        println!(
            "{:>9} {:>9} {:>7} {:>9} {:>10} {:>9} {:>10} {:>10} {:>10} {:>7} {:>9} {:>6}",
            "scene",
            "n",
            "moving",
            "motion",
            "edit µs",
            "visit",
            "total",
            "p99",
            "whole",
            "ratio",
            "changes",
            "bytes"
        );
    }
    for &name in &options.scenes {
        for &n in &options.sizes {
            for &motion in &options.motions {
                let mut world = World::new(name, n);
                let mut scene = session.scene(SceneOptions::default());
                let all: Vec<u32> = (0..n as u32).collect();
                edit(&mut scene, &all, world.boxes(), false)?;
                for &percent in &options.percents {
                    let moving = (n as f64 * percent / 100.0).round() as usize;
                    let mut times = Times::default();
                    let (mut changes, mut pair_count) = (0, 0);
                    for frame in 0..options.frames + WARM_UP {
                        let (indices, boxes) = world.step(moving, motion);
                        let is_spawn = motion == Motion::Spawn;
                        let (round_trip, visit, changed) =
                            edit(&mut scene, &indices, &boxes, is_spawn)?;
                        let (whole, pairs) = whole_frame(&mut session, world.boxes())?;
                        if frame >= WARM_UP {
                            times.round_trip.push(round_trip);
                            times.visit.push(visit);
                            times.total.push(round_trip + visit);
                            times.whole.push(whole);
                        }
                        (changes, pair_count) = (changed, pairs);
                    }
                    let told = scene.edit().commit(Want::Changes)?;
                    assert_eq!(
                        told.pair_count(),
                        Some(pair_count),
                        "the scene and the frame differ"
                    );
                    drop(told);
                    let [round_trip, visit] =
                        [&mut times.round_trip, &mut times.visit].map(|times| at(times, 0.5));
                    let (p99, total) = (at(&mut times.total, 0.99), at(&mut times.total, 0.5));
                    let whole = at(&mut times.whole, 0.5);
                    let ratio = total as f64 / whole as f64;
                    let bytes = scene.allocated_bytes() as f64 / n as f64;
                    rows.push(json!({
                        "scene": name.to_string(), "n": n, "moving": percent / 100.0,
                        "motion": motion.name(), "backend": "in-process", "engine": "scene",
                        "round_trip_ns": round_trip, "visit_ns": visit, "total_ns": total,
                        "p99_ns": p99, "peer": "whole frame", "peer_ns": whole, "ratio": ratio,
                        "changes": changes, "bytes_a_box": bytes,
                    }));
                    if !options.json {
                        let us = |ns: u64| ns as f64 / 1e3;
                        println!(
                            "{name:>9} {n:>9} {percent:>6}% {:>9} {:>10.1} {:>9.1} {:>10.1} {:>10.1} {:>10.1} {ratio:>7.4} {changes:>9} {bytes:>6.0}",
                            motion.name(),
                            us(round_trip),
                            us(visit),
                            us(total),
                            us(p99),
                            us(whole),
                        );
                    }
                }
            }
        }
    }
    if options.json {
        println!("{}", serde_json::to_string_pretty(&json!({ "rows": rows }))?);
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
