//! Queries of a scene, and set A against set B: median µs, everything between the client's boxes and its
//! pairs.
//!
//! * `queries`: boxes like those of the scene, asked of it in turns of several sets. `ask` is from boxes that
//!   lie in the client's memory to the answer, so writing them and the round trip; `iterate` looks at all pairs.
//!   `first` is the first query, which builds the cells. Of `ask`, `engine` found the pairs, and `publish`
//!   wrote them into the answer, as that itself says.
//! * `two sets`: the first boxes of a frame against all others, beside the whole frame, in turns. The ratio is
//!   that of the two medians.

use std::error::Error;
use std::time::Instant;

use clap::Parser;
use pairmask::FrameOptions;
use pairmask_tests::frames::two_sets;
use pairmask_tests::measure::{self, iterate, percentile, print_row};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::spawn::PrivateDaemon;
use serde_json::{Value, json};

const WARM_UP: usize = 5;
/// Sets of queries that take turns, so that no answer lies in the caches from the one before.
const SETS: usize = 8;

/// Queries of a scene, and set A against set B.
#[derive(Parser)]
struct Options {
    #[arg(long, value_delimiter = ',', default_value = "in-process,daemon")]
    backend: Vec<Backend>,
    /// A GPU of the daemon, whose video memory keeps the scenes that are asked
    #[arg(long, default_value_t = GpuChoice::None)]
    gpu: GpuChoice,
    #[arg(long, default_value_t = 1_000_000)]
    n: usize,
    #[arg(long, default_value_t = 10_000)]
    queries: usize,
    #[arg(long, default_value_t = 30)]
    rounds: usize,
    #[arg(long)]
    json: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn micros(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e6
}

fn session(daemon: &PrivateDaemon, backend: Backend, n: usize) -> Result<Session, Box<dyn Error>> {
    let capacity = BoxCount::new(u32::try_from(n)?);
    Ok(daemon.session().backend(backend).capacity(capacity).answer_repeats(false).connect()?)
}

/// A session whose scenes are where they are to be measured: those of a daemon in video memory, if it has a GPU. By
/// themselves they move there when they have been asked more.
fn session_of_scenes(
    daemon: &PrivateDaemon,
    backend: Backend,
    options: &Options,
) -> Result<Session, Box<dyn Error>> {
    let is_in_video = backend == Backend::Daemon && options.gpu != GpuChoice::None;
    if !is_in_video {
        return session(daemon, backend, options.n);
    }
    let engine = EngineChoice::Only(EngineName::GpuGrid);
    Ok(daemon.session().backend(backend).engine(engine).answer_repeats(false).connect()?)
}

fn ask(
    daemon: &PrivateDaemon,
    backend: Backend,
    name: SceneName,
    options: &Options,
) -> Result<Value, Box<dyn Error>> {
    let n = options.n;
    let boxes = Scene::new(name, n, 1).boxes().to_vec();
    // Boxes of the same place: every so many of a scene as large.
    let others = Scene::new(name, n, 2).boxes().to_vec();
    let step = (n / options.queries).max(1);
    let sets: Vec<Vec<Aabb>> = (0..SETS)
        .map(|set| others.iter().copied().skip(set % step).step_by(step).take(options.queries))
        .map(Iterator::collect)
        .collect();
    let mut session = session_of_scenes(daemon, backend, options)?;
    let mut scene = session.scene(pairmask::SceneOptions::default())?;
    let edit = scene.edit().set_all(0..u32::try_from(n)?, &boxes);
    drop(edit.commit(Report::Nothing)?);
    let begin = Instant::now();
    drop(scene.query(&sets[0])?);
    let first = micros(begin);
    let (mut asks, mut iterations, mut totals, mut pairs) = (vec![], vec![], vec![], 0);
    let (mut engines, mut publishes) = (vec![], vec![]);
    for round in 0..WARM_UP + options.rounds {
        let begin = Instant::now();
        let answer = scene.query(&sets[round % SETS])?;
        let asked = micros(begin);
        iterate(|each| answer.for_each_slice(each));
        let total = micros(begin);
        pairs = answer.count();
        if round >= WARM_UP {
            asks.push(asked);
            iterations.push(total - asked);
            totals.push(total);
            let times = answer.mask().info().times;
            engines.push(times.execute_ns as f64 / 1e3);
            publishes.push(times.publish_ns as f64 / 1e3);
        }
    }
    let [ask, iterate, total, engine, publish] =
        [asks, iterations, totals, engines, publishes].map(|times| percentile(&times, 0.5));
    Ok(json!({
        "row": "queries", "backend": backend.to_string(), "scene": name.to_string(), "n": n,
        "queries": options.queries, "pairs": pairs, "first_us": first, "ask_us": ask,
        "iterate_us": iterate, "total_us": total, "engine_us": engine, "publish_us": publish,
    }))
}

fn between_and_whole(
    daemon: &PrivateDaemon,
    backend: Backend,
    name: SceneName,
    first: usize,
    options: &Options,
) -> Result<Value, Box<dyn Error>> {
    let n = options.n;
    let mut scene = Scene::new(name, n, 1);
    let mut session = session(daemon, backend, n)?;
    let mut times = [vec![], vec![]];
    let mut counts = [0; 2];
    for round in 0..WARM_UP + options.rounds {
        scene.step();
        for turn in 0..2 {
            let who = (round + turn) % 2;
            let mut frame = session.frame(n)?;
            frame.write(scene.boxes())?;
            let begin = Instant::now();
            let options = [two_sets(first), FrameOptions::default()];
            let mask = frame.submit_with(&options[who])?.wait()?;
            iterate(|each| mask.for_each_slice(each));
            let took = micros(begin);
            counts[who] = mask.count();
            if round >= WARM_UP {
                times[who].push(took);
            }
        }
    }
    let [between, whole] = times.map(|times| percentile(&times, 0.5));
    Ok(json!({
        "row": "two sets", "backend": backend.to_string(), "scene": name.to_string(), "n": n,
        "first": first, "pairs": counts[0], "all_pairs": counts[1], "between_us": between,
        "whole_us": whole, "ratio": between / whole,
    }))
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    let daemon = measure::daemon(options.gpu.clone())?;
    let mut rows = Vec::new();
    let mut note = |row: Value| {
        if !options.json {
            let columns = match row["row"].as_str() {
                Some("queries") => {
                    "queries pairs first_us ask_us engine_us publish_us iterate_us total_us"
                }
                _ => "first pairs between_us whole_us ratio",
            };
            print_row(&row, &format!("row backend scene n {columns}"));
        }
        rows.push(row);
    };
    for backend in &options.backend {
        for name in [SceneName::Uniform, SceneName::Pile] {
            note(ask(&daemon, *backend, name, &options)?);
        }
        for share in [1_000, 100, 10, 2] {
            let first = (options.n / share).max(1);
            note(between_and_whole(&daemon, *backend, SceneName::Uniform, first, &options)?);
        }
    }
    if options.json {
        println!("{}", Value::Array(rows));
    }
    Ok(())
}
