//! What counting costs: ns a frame in the worker, alone and beside threads that serve others, and what a reader of the
//! counters changes of a frame's p99.
//!
//! The second part takes turns with and without a reader, of some hundred ms each, so that a busy machine disturbs both.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use pairmask_core::dispatch::StageTimes;
use pairmask_tests::measure::{daemon, percentile};
use pairmask_tests::prelude::*;
use pairmask_transport::{
    Answered, AnsweredOf, AnsweredTotals, ClientSlot, Counters, RuntimeDir, TotalCounts,
};
use pairmask_wire::InstanceName;
use pairmaskd::execute::gpu::GpuChoice;

/// What counting costs.
#[derive(Parser)]
struct Options {
    /// Boxes of a frame
    #[arg(long, default_value_t = 1_000)]
    n: usize,
    /// Frames a turn
    #[arg(long, default_value_t = 2_000)]
    frames: usize,
    /// Turns with a reader, and without
    #[arg(long, default_value_t = 20)]
    turns: usize,
    /// Looks of the reader a second
    #[arg(long, default_value_t = 10.0)]
    hertz: f64,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Frames of a thread between two looks at the clock.
const COUNTED: u64 = 100_000;
const ROUNDS: usize = 15;

/// All that a frame adds: its receipt, its turn, its answer and its end.
fn count_frame(counters: &Counters, client: &ClientSlot, frame: u64) {
    counters.note_queue(1, 0);
    counters.note_queue(0, 1);
    client.note_received(24_000, frame & 0xff);
    let times = StageTimes { execute_ns: frame, total_ns: frame, ..StageTimes::default() };
    counters.note_answered(AnsweredTotals { frames: frame, boxes: frame, ..Default::default() });
    client.note_answered(&Answered {
        token: 7,
        objects: 1_000,
        pairs: 500,
        of: AnsweredOf::Frame,
        engine: EngineName::CpuGrid,
        threads: 2,
        times,
    });
    client.note_sent(4096, frame);
    client.note_used(frame);
    counters.note_queue(0, 0);
}

/// ns a frame of each of so many threads, the median of some rounds and the fastest and slowest.
fn counting(threads: usize) -> [f64; 3] {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let dir = RuntimeDir::at(dir.path().join("instance"));
    dir.ensure().expect("a directory of our own");
    let counters = Counters::create(&dir, &InstanceName::default(), 100).expect("a file");
    let mut rounds = Vec::new();
    for _ in 0..ROUNDS {
        let clients: Vec<_> = (1..=threads as u64).map(|n| counters.client(n, 0, 0)).collect();
        let times = std::thread::scope(|scope| {
            let count = |client: ClientSlot| {
                let counters = Arc::clone(&counters);
                move || {
                    let start = Instant::now();
                    for frame in 0..COUNTED {
                        count_frame(black_box(&counters), &client, frame);
                    }
                    start.elapsed().as_nanos() as f64 / COUNTED as f64
                }
            };
            let all: Vec<_> = clients.into_iter().map(|c| scope.spawn(count(c))).collect();
            all.into_iter().map(|thread| thread.join().expect("no panic")).collect::<Vec<_>>()
        });
        rounds.push(times.iter().sum::<f64>() / threads as f64);
    }
    [0.5, 0.0, 1.0].map(|share| percentile(&rounds, share))
}

/// The p50 and p99 of frames in a closed loop, µs.
fn turn(session: &mut Session, scenes: &[Vec<Aabb>], frames: usize) -> [f64; 2] {
    let times: Vec<f64> = (0..frames)
        .map(|frame| {
            let start = Instant::now();
            black_box(session.answer(&scenes[frame % scenes.len()]).count());
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    [0.5, 0.99].map(|share| percentile(&times, share))
}

fn reading(options: &Options) {
    let daemon = daemon(GpuChoice::None).expect("a daemon");
    let mut session = daemon.session().answer_repeats(false).connect().expect("it serves");
    let scenes: Vec<_> =
        (0..4).map(|seed| stress_scenes::named("uniform").boxes(options.n as u32, seed)).collect();
    turn(&mut session, &scenes, options.frames);
    let (dir, name) = (daemon.dir(), daemon.instance());
    let interval = Duration::from_secs_f64(1.0 / options.hertz);
    let mut turns = [Vec::new(), Vec::new()];
    let mut ratios = [Vec::new(), Vec::new()];
    let mut looks = 0_u64;
    for at in 0..options.turns {
        let mut found = [[0.0; 2]; 2];
        // Either order as often.
        for has_reader in if at % 2 == 0 { [false, true] } else { [true, false] } {
            let stop = AtomicBool::new(!has_reader);
            found[usize::from(has_reader)] = std::thread::scope(|scope| {
                let reader = scope.spawn(|| {
                    let mut looks = 0;
                    while !stop.load(Ordering::Relaxed) {
                        let sample = dir.read_counters(&name).expect("our own file");
                        let totals = sample.map_or(TotalCounts::default(), |s| s.totals);
                        looks += u64::from(totals.frames > 0);
                        std::thread::park_timeout(interval);
                    }
                    looks
                });
                let took = turn(&mut session, &scenes, options.frames);
                stop.store(true, Ordering::Relaxed);
                reader.thread().unpark();
                looks += reader.join().expect("no panic");
                took
            });
        }
        for which in 0..2 {
            turns[which].push(found[which]);
            ratios[which].push(found[1][which] / found[0][which]);
        }
    }
    println!(
        "\n{} boxes, {} turns of {} frames each, {looks} looks at {} Hz\n",
        options.n, options.turns, options.frames, options.hertz
    );
    println!("| | p50 µs | p99 µs |\n|---|---|---|");
    for (what, turns) in ["no reader", "a reader"].into_iter().zip(&turns) {
        let median =
            |which: usize| percentile(&turns.iter().map(|t| t[which]).collect::<Vec<_>>(), 0.5);
        println!("| {what} | {:.1} | {:.1} |", median(0), median(1));
    }
    let text = |ratios: &[f64]| {
        let [low, median, high] = [0.25, 0.5, 0.75].map(|share| percentile(ratios, share));
        format!("{median:.3} ({low:.3} to {high:.3})")
    };
    println!(
        "| ratio of turns: median and quartiles | {} | {} |",
        text(&ratios[0]),
        text(&ratios[1])
    );
}

fn main() {
    let options = Options::parse();
    println!("| threads | ns a frame | fastest | slowest |\n|---|---|---|---|");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    for threads in [1, 2, 4, 8, 16].into_iter().filter(|threads| *threads <= cores) {
        let [median, fastest, slowest] = counting(threads);
        println!("| {threads} | {median:.0} | {fastest:.0} | {slowest:.0} |");
    }
    reading(&options);
}
