//! Scenes that persist beside whole frames: what an edit and its changes cost, by how much moves.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench skip -- [--n 10000,100000] [--scene uniform,pile]
//!     [--moving 0,0.1,1,10,100] [--motion drift,jitter,teleport,spawn] [--frames 20]
//!     [--backend in-process,daemon] [--peer frame|rapier] [--json]
//! ```
//!
//! Both are made by one session, in turns. In process they have the threads of this machine: a pool of
//! which the calling thread is one, so that small edits do not wait for another to wake. `daemon` asks the
//! instance of the environment, which is to be started first. Write: the arrays of indices and boxes in, the
//! edit sent (in process: answered too); round trip: until the answer is there; visit: every change read,
//! and the answer taken. The peer `frame` is a whole frame, written, culled, and every pair of it visited;
//! `rapier` is rapier's broad phase in the same state: it is given the boxes that moved, and its events are
//! kept as a list (of pairs of boxes that it grows by a margin). A ratio below 1 is in favour of the scene.
//! `bytes` are what the daemon or, in process, this process keeps of the scene, a box.

use std::error::Error;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use pairmask::scene::{Indices, SceneOptions, Want};
use pairmask::{Aabb, Backend, EngineId, Scene, Session};
use pairmask_lab::study::moving::{Motion, World};
#[cfg(feature = "peers")]
use pairmask_tests::peers::rapier::Rapier;
use pairmaskd::scene::SceneName;
use serde_json::{Value, json};

/// Frames that are not counted: cells are built, memory is taken.
const WARM_UP: usize = 3;
struct Options {
    sizes: Vec<usize>,
    scenes: Vec<SceneName>,
    percents: Vec<f64>,
    motions: Vec<Motion>,
    frames: usize,
    backends: Vec<Backend>,
    with_rapier: bool,
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
            backends: vec![Backend::InProcess],
            with_rapier: false,
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
                "--backend" => {
                    let parse = |s: &str| s.parse().map_err(|e| format!("{e}"));
                    options.backends = items().map(parse).collect::<Result<_, _>>()?;
                }
                "--peer" => match value.as_str() {
                    "frame" => options.with_rapier = false,
                    "rapier" if cfg!(feature = "peers") => options.with_rapier = true,
                    "rapier" => return Err("rapier needs --features peers".into()),
                    _ => return Err(format!("unknown peer '{value}'")),
                },
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
    write: Vec<u64>,
    round_trip: Vec<u64>,
    visit: Vec<u64>,
    total: Vec<u64>,
    peer: Vec<u64>,
}

fn at(values: &mut [u64], share: f64) -> u64 {
    values.sort_unstable();
    let place = (values.len().saturating_sub(1) as f64 * share).round() as usize;
    values.get(place).copied().unwrap_or(0)
}

/// An edit of a scene, its changes visited and taken: write, round trip, visit, how many changes, and what
/// answered.
fn edit(
    scene: &mut Scene,
    indices: &[u32],
    boxes: &[Aabb],
    is_spawn: bool,
) -> Result<([u64; 3], usize, EngineId), Box<dyn Error>> {
    let all = indices.len() == scene.len();
    let these = if all { Indices::from(0..indices.len() as u32) } else { indices.into() };
    let begin = Instant::now();
    let mut edit = scene.edit().set_all(these, boxes);
    if is_spawn {
        edit = edit.remove_all(these);
    }
    let pending = edit.submit(Want::Changes)?;
    let write = begin.elapsed().as_nanos() as u64;
    let answer = pending.wait()?;
    let answered = begin.elapsed().as_nanos() as u64;
    let told = answer.take();
    let mut sum = 0;
    let mut visit = |pairs: &[[u32; 2]]| {
        sum += pairs.iter().fold(0u64, |sum, [a, b]| sum + u64::from(a ^ b));
    };
    told.begun().for_each_slice(&mut visit);
    told.pairs().for_each_slice(&mut visit);
    sum += told.ended().iter().fold(0u64, |sum, e| sum + u64::from(e.pair[0] ^ e.pair[1]));
    black_box(sum);
    let times = [write, answered - write, begin.elapsed().as_nanos() as u64 - answered];
    Ok((times, told.begun().len() + told.ended().len(), told.engine()))
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

/// What a scene is set beside.
enum Peer {
    Frame,
    #[cfg(feature = "peers")]
    Rapier(Box<Rapier>),
}

impl Peer {
    #[cfg(feature = "peers")]
    fn new(options: &Options, n: usize) -> Self {
        if options.with_rapier { Self::Rapier(Box::new(Rapier::new(n))) } else { Self::Frame }
    }

    #[cfg(not(feature = "peers"))]
    const fn new(_: &Options, _: usize) -> Self {
        Self::Frame
    }

    /// The same change: ns.
    fn change(
        &mut self,
        session: &mut Session,
        world: &World,
        #[cfg_attr(not(feature = "peers"), expect(unused))] moved: &[u32],
    ) -> Result<u64, Box<dyn Error>> {
        match self {
            Self::Frame => Ok(whole_frame(session, world.boxes())?.0),
            #[cfg(feature = "peers")]
            Self::Rapier(rapier) => {
                let begin = Instant::now();
                let boxes = moved.iter().map(|i| (*i, &world.boxes()[*i as usize]));
                black_box(rapier.change(boxes)?);
                Ok(begin.elapsed().as_nanos() as u64)
            }
        }
    }
}

/// The frames of one row.
fn row(
    options: &Options,
    session: &mut Session,
    (scene, world, peer): (&mut Scene, &mut World, &mut Peer),
    motion: Motion,
    percent: f64,
) -> Result<Value, Box<dyn Error>> {
    let n = world.boxes().len();
    let moving = (n as f64 * percent / 100.0).round() as usize;
    let mut times = Times::default();
    let mut last = None;
    for frame in 0..options.frames + WARM_UP {
        let (indices, boxes) = world.step(moving, motion);
        let ([write, round_trip, visit], changes, engine) =
            edit(scene, &indices, &boxes, motion == Motion::Spawn)?;
        let took = peer.change(session, world, &indices)?;
        if frame >= WARM_UP {
            times.write.push(write);
            times.round_trip.push(round_trip);
            times.visit.push(visit);
            times.total.push(write + round_trip + visit);
            times.peer.push(took);
        }
        last = Some((changes, engine));
    }
    let (_, pair_count) = whole_frame(session, world.boxes())?;
    let told = scene.edit().commit(Want::Changes)?;
    assert_eq!(told.pair_count(), Some(pair_count), "the scene and the frame differ");
    drop(told);
    let Times { mut write, mut round_trip, mut visit, mut total, peer: mut peers } = times;
    let [write, round_trip, visit, took] =
        [&mut write, &mut round_trip, &mut visit, &mut peers].map(|times| at(times, 0.5));
    let (p99, total) = (at(&mut total, 0.99), at(&mut total, 0.5));
    let kept = if scene.daemon_bytes() > 0 {
        scene.daemon_bytes() as f64
    } else {
        scene.allocated_bytes() as f64
    };
    let (changes, engine) = last.ok_or("no frame")?;
    let peer = if matches!(peer, Peer::Frame) { "whole frame" } else { "rapier" };
    Ok(json!({
        "n": n, "moving": percent / 100.0, "motion": motion.name(), "engine": engine.to_string(),
        "write_ns": write, "round_trip_ns": round_trip, "visit_ns": visit, "total_ns": total,
        "p99_ns": p99, "peer": peer, "peer_ns": took, "ratio": total as f64 / took as f64,
        "changes": changes, "bytes_a_box": kept / n as f64,
    }))
}

fn print_row(row: &Value) {
    let us = |name: &str| row[name].as_f64().unwrap_or(0.0) / 1e3;
    let text = |name: &str| row[name].as_str().unwrap_or("").to_owned();
    println!(
        "{:>9} {:>9} {:>7}% {:>9} {:>10} {:>9.1} {:>10.1} {:>9.1} {:>10.1} {:>10.1} {:>10.1} {:>7.4} {:>9} {:>6.0}",
        text("scene"),
        row["n"],
        row["moving"].as_f64().unwrap_or(0.0) * 100.0,
        text("motion"),
        text("engine"),
        us("write_ns"),
        us("round_trip_ns"),
        us("visit_ns"),
        us("total_ns"),
        us("p99_ns"),
        us("peer_ns"),
        row["ratio"].as_f64().unwrap_or(0.0),
        row["changes"],
        row["bytes_a_box"].as_f64().unwrap_or(0.0),
    );
}

fn run() -> Result<(), Box<dyn Error>> {
    let options = Options::parse()?;
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global()?;
    let mut rows = Vec::new();
    if !options.json {
        println!(
            "{:>9} {:>9} {:>8} {:>9} {:>10} {:>9} {:>10} {:>9} {:>10} {:>10} {:>10} {:>7} {:>9} {:>6}",
            "scene",
            "n",
            "moving",
            "motion",
            "engine",
            "write µs",
            "answer",
            "visit",
            "total",
            "p99",
            "peer",
            "ratio",
            "changes",
            "bytes"
        );
    }
    for &backend in &options.backends {
        // The whole frame of a scene at rest is culled, too: that is what the scene is set beside.
        let mut session = Session::builder().backend(backend).answer_repeats(false).connect()?;
        for &name in &options.scenes {
            for &n in &options.sizes {
                for &motion in &options.motions {
                    let mut world = World::new(name, n);
                    let mut scene = session.scene(SceneOptions::default());
                    let all: Vec<u32> = (0..n as u32).collect();
                    edit(&mut scene, &all, world.boxes(), false)?;
                    let mut peer = Peer::new(&options, n);
                    peer.change(&mut session, &world, &all)?;
                    for &percent in &options.percents {
                        let parts = (&mut scene, &mut world, &mut peer);
                        let mut row = row(&options, &mut session, parts, motion, percent)?;
                        row["scene"] = name.to_string().into();
                        row["backend"] = backend.to_string().into();
                        if !options.json {
                            print_row(&row);
                        }
                        rows.push(row);
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
