//! Frames with rules beside frames without: worlds side by side, and pairs that filters take out.
//!
//! Each row has two ways to the same pairs, or to a scene and its filtered part, in turns; the ratio is
//! that of the medians, below 1 in favour of the first. Beside each median stand the quartiles. All pairs
//! are iterated over. Each way has a session of its own, which culls each frame anew.
//!
//! * `worlds`: boxes of 4,096 worlds that lie over one another, against one world in which they lie side by
//!   side, with as many boxes and pairs.
//! * `requests`: the same worlds against a request for each of them.
//! * `filtered`: a scene of ten kinds that meet their own alone, against the same scene without filters.
//! * `no rules`: a frame with rules that let all pairs meet, against one without rules.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use pairmask_core::filters::{Filter, FilterData, FilterId, FilterTable, Rules, World};
use pairmask_tests::frames::filtered;
use pairmask_tests::measure::{self, iterate, percentile, print_row};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::Random;
use pairmaskd::spawn::PrivateDaemon;
use serde_json::{Value, json};

const WORLDS: usize = 4_096;
/// Worlds in a line of the scene in which they lie side by side.
const LINE: usize = 16;
const KINDS: usize = 10;

/// Frames with rules beside frames without.
#[derive(Parser)]
struct Options {
    #[arg(long, default_value_t = 20)]
    rounds: usize,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    #[arg(long)]
    json: bool,
    #[arg(long, default_value_t = Backend::InProcess)]
    backend: Backend,
    #[arg(long, default_value_t = GpuChoice::None)]
    gpu: GpuChoice,
    #[arg(long, value_delimiter = ',', default_value = "worlds,requests,filtered,rules")]
    rows: Vec<String>,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Boxes of side 1 in a cube, each over about one other.
fn cube(random: &mut Random, n: usize) -> Vec<Aabb> {
    let side = (4.0 * n as f32).cbrt();
    let mut corner = || [0; 3].map(|_| random.unit() * side);
    (0..n).map(|_| corner()).map(|low| Aabb::new(low, low.map(|x| x + 1.0))).collect()
}

struct Way {
    session: Session,
    times: Vec<u64>,
}

impl Way {
    fn new(daemon: &PrivateDaemon, options: &Options) -> Result<Self, Box<dyn Error>> {
        let builder = daemon.session().backend(options.backend).threads(options.threads);
        Ok(Self { session: builder.answer_repeats(false).connect()?, times: Vec::new() })
    }

    /// Answers a frame and iterates over its pairs: ns, and how many pairs.
    fn answer(
        &mut self,
        boxes: &[Aabb],
        rules: Option<&Arc<Rules>>,
    ) -> Result<(u64, u64), Box<dyn Error>> {
        // Boxes are written where they are sent from: in a game that is no copy.
        let mut frame = self.session.frame(boxes.len())?;
        frame.write(boxes)?;
        let begin = Instant::now();
        let pending = frame.submit_with(&rules.map(filtered).unwrap_or_default())?;
        let mask = pending.wait()?;
        let count = iterate(|each| mask.for_each_slice(each));
        Ok((begin.elapsed().as_nanos() as u64, count))
    }

    fn spread(&self) -> [u64; 3] {
        [0.5, 0.25, 0.75].map(|share| percentile(&self.times, share))
    }
}

type Frame<'a> = dyn FnMut(&mut Way) -> Result<(u64, u64), Box<dyn Error>> + 'a;

/// A row of two ways, in turns.
fn row(
    name: &str,
    options: &Options,
    daemon: &PrivateDaemon,
    first: &mut Frame<'_>,
    second: &mut Frame<'_>,
) -> Result<Value, Box<dyn Error>> {
    let way = || Way::new(daemon, options);
    let (rounds, mut ways) = (options.rounds, [way()?, way()?]);
    let mut pairs = [0; 2];
    // The first rounds are not counted: memory is taken.
    for round in 0..rounds + 3 {
        let frames: [&mut Frame<'_>; 2] = [first, second];
        for ((way, frame), pairs) in ways.iter_mut().zip(frames).zip(&mut pairs) {
            let (ns, count) = frame(way)?;
            *pairs = count;
            if round >= 3 {
                way.times.push(ns);
            }
        }
    }
    let [one, other] = ways.each_ref().map(Way::spread);
    Ok(json!({
        "row": name, "first_ns": one[0], "second_ns": other[0],
        "ratio": one[0] as f64 / other[0] as f64,
        "first_quartiles_ns": one[1..], "second_quartiles_ns": other[1..],
        "first_pairs": pairs[0], "second_pairs": pairs[1],
    }))
}

/// Boxes of worlds that lie over one another, their filter data, and the same boxes with their worlds side by side.
fn worlds(each: usize) -> (Vec<Aabb>, Arc<Rules>, Vec<Aabb>) {
    let mut random = Random::new(1);
    let (mut over, mut beside, mut rules) = (Vec::new(), Vec::new(), Rules::default());
    for world in 0..WORLDS {
        let cube = cube(&mut random, each);
        let side = (4.0 * each as f32).cbrt() + 2.0;
        let at = [world % LINE, world / LINE % LINE, world / (LINE * LINE)];
        let shift = at.map(|at| at as f32 * side);
        let moved = |point: [f32; 3]| [0, 1, 2].map(|axis| point[axis] + shift[axis]);
        beside.extend(cube.iter().map(|b| Aabb::new(moved(b.min), moved(b.max))));
        over.extend(cube);
        let filter_data = FilterData::default().with_world(World(world as i32));
        rules.filter_data.resize(over.len(), filter_data);
    }
    (over, Arc::new(rules), beside)
}

fn rows(options: &Options, daemon: &PrivateDaemon) -> Result<Vec<Value>, Box<dyn Error>> {
    let asks_for = |row: &str| options.rows.iter().any(|requested| requested == row);
    let mut rows = Vec::new();
    for each in [32, 256] {
        if !asks_for("worlds") && !asks_for("requests") {
            break;
        }
        let (over, rules, beside) = worlds(each);
        let name = format!("worlds {WORLDS} x {each}");
        let mut by_world = |way: &mut Way| way.answer(&over, Some(&rules));
        let mut as_one = |way: &mut Way| way.answer(&beside, None);
        if asks_for("worlds") {
            rows.push(row(&name, options, daemon, &mut by_world, &mut as_one)?);
        }
        if each == 32 && asks_for("requests") {
            let name = format!("requests {WORLDS} x {each}");
            let mut requests = |way: &mut Way| {
                let (mut ns, mut pairs) = (0, 0);
                for world in over.chunks(each) {
                    let (took, count) = way.answer(world, None)?;
                    ns += took;
                    pairs += count;
                }
                Ok((ns, pairs))
            };
            rows.push(row(&name, options, daemon, &mut by_world, &mut requests)?);
        }
    }
    for n in [10_000, 100_000, 1_000_000] {
        // Boxes of side 3: some thirty pairs a box.
        let mut boxes = cube(&mut Random::new(2), n);
        for b in &mut boxes {
            b.max = b.min.map(|x| x + 3.0);
        }
        let kinds: Vec<Filter> = (0..KINDS).map(|kind| Filter::new(1 << kind, 1 << kind)).collect();
        let mut rules = Rules::default();
        rules.table = FilterTable::new(&kinds)?;
        let mut random = Random::new(3);
        rules.filter_data = (0..n)
            .map(|_| FilterId((random.unit() * KINDS as f32) as u16))
            .map(|id| FilterData::default().with_filter(id))
            .collect();
        let rules = Arc::new(rules);
        let mut filtered = |way: &mut Way| way.answer(&boxes, Some(&rules));
        let mut without = |way: &mut Way| way.answer(&boxes, None);
        if asks_for("filtered") {
            let name = format!("filtered {n}");
            rows.push(row(&name, options, daemon, &mut filtered, &mut without)?);
        }
        let open = Arc::new(Rules::default());
        let mut with_open = |way: &mut Way| way.answer(&boxes, Some(&open));
        if asks_for("rules") {
            let name = format!("no rules {n}");
            rows.push(row(&name, options, daemon, &mut with_open, &mut without)?);
        }
    }
    Ok(rows)
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads);
    pool.use_current_thread().build_global()?;
    let daemon = measure::daemon(options.gpu.clone())?;
    let rows = rows(&options, &daemon)?;
    if options.json {
        let (backend, threads) = (options.backend.to_string(), options.threads);
        let all = json!({ "backend": backend, "threads": threads, "rows": rows });
        println!("{}", serde_json::to_string_pretty(&all)?);
        return Ok(());
    }
    let columns = "row first_ns first_quartiles_ns second_ns second_quartiles_ns ratio first_pairs \
                   second_pairs";
    for row in &rows {
        print_row(row, columns);
    }
    Ok(())
}
