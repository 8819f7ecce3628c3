//! Frames with rules beside frames without: worlds side by side, and pairs that filters take out.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench filters -- [--rounds 20] [--threads 2] [--json]
//! ```
//!
//! Each row has two ways to the same pairs, or to a scene and its filtered part, in turns; the ratio is
//! that of the medians, below 1 in favour of the first. All pairs are visited.
//!
//! * `worlds`: boxes of 4,096 worlds that lie over one another, against one world in which they lie side by
//!   side, with as many boxes and pairs.
//! * `requests`: the same worlds against a request in process for each of them.
//! * `filtered`: a scene of ten kinds that meet their own alone, against the same scene without filters.
//! * `no rules`: a frame with rules that let all pairs meet, against one without rules.

use std::error::Error;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use pairmask_core::dispatch::{CpuEngines, CullOptions};
use pairmask_core::engine::HeapReply;
use pairmask_core::filters::{Filter, FilterId, FilterTable, Rules, Tag, World};
use pairmask_core::{Aabb, BoxCount, MaskView};
use serde_json::{Value, json};

/// Worlds of each row of worlds.
const WORLDS: usize = 4_096;
/// Worlds in a line of the scene in which they lie side by side.
const LINE: usize = 16;
/// Kinds of the scene that is filtered.
const KINDS: usize = 10;

struct Options {
    rounds: usize,
    threads: usize,
    json: bool,
}

impl Options {
    fn parse() -> Result<Self, String> {
        let mut options = Self { rounds: 20, threads: 2, json: false };
        let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
        while let Some(flag) = args.next() {
            if flag == "--json" {
                options.json = true;
                continue;
            }
            let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?;
            let number = value.parse::<usize>().map_err(|error| format!("{value}: {error}"))?;
            match flag.as_str() {
                "--rounds" => options.rounds = number.max(1),
                "--threads" => options.threads = number.max(1),
                _ => return Err(format!("unknown option {flag}")),
            }
        }
        Ok(options)
    }
}

/// A small generator: xorshift.
struct Random(u64);

impl Random {
    /// From 0 to 1.
    fn unit(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    /// Boxes of side 1 in a cube, each over about one other.
    fn cube(&mut self, n: usize) -> Vec<Aabb> {
        let side = (4.0 * n as f32).cbrt();
        let mut corner = || [0; 3].map(|_| self.unit() * side);
        (0..n).map(|_| corner()).map(|low| Aabb::new(low, low.map(|x| x + 1.0))).collect()
    }
}

/// One way to answer a frame.
struct Way {
    engines: CpuEngines,
    reply: HeapReply,
    last_pairs: Option<u64>,
    times: Vec<u64>,
}

impl Way {
    fn new() -> Self {
        let (engines, reply) = (CpuEngines::new(), HeapReply::new());
        Self { engines, reply, last_pairs: None, times: Vec::new() }
    }

    /// Answers a frame and visits its pairs: ns, and how many pairs.
    fn answer(
        &mut self,
        boxes: &[Aabb],
        rules: Option<&Rules>,
        threads: usize,
    ) -> Result<(u64, u64), Box<dyn Error>> {
        let options = CullOptions {
            threads: Some(threads),
            last_pairs: self.last_pairs,
            ..CullOptions::default()
        };
        let begin = Instant::now();
        let report = match rules {
            Some(rules) => {
                let reply = &mut self.reply;
                self.engines.cull_filtered(boxes, rules, &options, reply)?.answer.report
            }
            None => self.engines.cull(boxes, &options, &mut self.reply)?.report,
        };
        let n = BoxCount::new(boxes.len() as u32);
        let (mut sum, mut count) = (0u64, 0);
        MaskView::new(n, &report.shape, self.reply.words())?.for_each_slice(|pairs| {
            sum = pairs.iter().fold(sum, |sum, [a, b]| sum + u64::from(a ^ b));
            count += pairs.len() as u64;
        });
        black_box(sum);
        self.last_pairs = Some(count);
        Ok((begin.elapsed().as_nanos() as u64, count))
    }

    fn median(&mut self) -> u64 {
        self.times.sort_unstable();
        self.times[self.times.len() / 2]
    }
}

/// What is answered one way or the other.
type Frame<'a> = dyn FnMut(&mut Way) -> Result<(u64, u64), Box<dyn Error>> + 'a;

/// A row of two ways, in turns.
fn row(
    name: &str,
    rounds: usize,
    first: &mut Frame<'_>,
    second: &mut Frame<'_>,
) -> Result<Value, Box<dyn Error>> {
    let mut ways = [Way::new(), Way::new()];
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
    let [one, other] = ways.each_mut().map(Way::median);
    Ok(json!({
        "row": name, "first_ns": one, "second_ns": other, "ratio": one as f64 / other as f64,
        "first_pairs": pairs[0], "second_pairs": pairs[1],
    }))
}

/// Boxes of worlds that lie over one another, their tags, and the same boxes with their worlds side by side.
fn worlds(each: usize) -> (Vec<Aabb>, Rules, Vec<Aabb>) {
    let mut random = Random(0x5DEE_CE66_D1CE_4E5B);
    let (mut over, mut beside, mut rules) = (Vec::new(), Vec::new(), Rules::default());
    for world in 0..WORLDS {
        let cube = random.cube(each);
        let side = (4.0 * each as f32).cbrt() + 2.0;
        let at = [world % LINE, world / LINE % LINE, world / (LINE * LINE)];
        let shift = at.map(|at| at as f32 * side);
        let moved = |point: [f32; 3]| [0, 1, 2].map(|axis| point[axis] + shift[axis]);
        beside.extend(cube.iter().map(|b| Aabb::new(moved(b.min), moved(b.max))));
        over.extend(cube);
        let tag = Tag::default().with_world(World(world as i32));
        rules.tags.resize(over.len(), tag);
    }
    (over, rules, beside)
}

fn rows(options: &Options) -> Result<Vec<Value>, Box<dyn Error>> {
    let Options { rounds, threads, .. } = *options;
    let mut rows = Vec::new();
    for each in [32, 256] {
        let (over, rules, beside) = worlds(each);
        let name = format!("worlds {WORLDS} x {each}");
        let mut by_world = |way: &mut Way| way.answer(&over, Some(&rules), threads);
        let mut as_one = |way: &mut Way| way.answer(&beside, None, threads);
        rows.push(row(&name, rounds, &mut by_world, &mut as_one)?);
        if each == 32 {
            let name = format!("requests {WORLDS} x {each}");
            let mut requests = |way: &mut Way| {
                let (mut ns, mut pairs) = (0, 0);
                for world in over.chunks(each) {
                    let (took, count) = way.answer(world, None, threads)?;
                    ns += took;
                    pairs += count;
                }
                Ok((ns, pairs))
            };
            rows.push(row(&name, rounds, &mut by_world, &mut requests)?);
        }
    }
    for n in [10_000, 100_000, 1_000_000] {
        let boxes: Vec<Aabb> = {
            let mut cube = Random(0x2545_F491_4F6C_DD1D).cube(n);
            // Boxes of side 3: some thirty pairs a box.
            for b in &mut cube {
                b.max = b.min.map(|x| x + 3.0);
            }
            cube
        };
        let kinds: Vec<Filter> = (0..KINDS).map(|kind| Filter::new(1 << kind, 1 << kind)).collect();
        let mut rules = Rules::default();
        rules.table = FilterTable::new(&kinds)?;
        let mut random = Random(0x9E37_79B9_7F4A_7C15);
        rules.tags = (0..n)
            .map(|_| FilterId((random.unit() * KINDS as f32) as u16))
            .map(|id| Tag::default().with_filter(id))
            .collect();
        let mut filtered = |way: &mut Way| way.answer(&boxes, Some(&rules), threads);
        let mut without = |way: &mut Way| way.answer(&boxes, None, threads);
        rows.push(row(&format!("filtered {n}"), rounds, &mut filtered, &mut without)?);
        let open = Rules::default();
        let mut with_open = |way: &mut Way| way.answer(&boxes, Some(&open), threads);
        rows.push(row(&format!("no rules {n}"), rounds, &mut with_open, &mut without)?);
    }
    Ok(rows)
}

fn run() -> Result<(), Box<dyn Error>> {
    let options = Options::parse()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads);
    pool.use_current_thread().build_global()?;
    let rows = rows(&options)?;
    if options.json {
        println!("{}", serde_json::to_string_pretty(&json!({ "rows": rows }))?);
        return Ok(());
    }
    for row in rows {
        let ms = |name: &str| row[name].as_f64().unwrap_or(0.0) / 1e6;
        println!(
            "{:>20} {:>9.3} ms {:>9.3} ms {:>7.3} {:>10} {:>10} pairs",
            row["row"].as_str().unwrap_or(""),
            ms("first_ns"),
            ms("second_ns"),
            row["ratio"].as_f64().unwrap_or(0.0),
            row["first_pairs"],
            row["second_pairs"],
        );
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
