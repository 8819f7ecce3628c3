//! A tick of a scene that four sessions write, beside one session that writes as many boxes in a scene of its
//! own: µs from the moment when the first begins its edit until the last has its changes, p50 and p99.
//!
//! Both take turns, tick by tick, with the same boxes and the same moves. Of each share of the boxes, other
//! ones move in each tick. Writers are threads, each with a session of its own; they spin until all of them are
//! awake, and take the time themselves: to wake threads for the next tick is no part of it.

use std::error::Error;
use std::hint::black_box;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use pairmask::{Scene, SceneOptions};
use pairmask_tests::measure::{self, percentile};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::spawn::PrivateDaemon;

const WRITERS: u32 = 4;
const WARM_UP: u64 = 10;
/// Shares of the boxes that move, %.
const SHARES: [u32; 3] = [1, 10, 100];
/// A deadline that no tick reaches.
const DEADLINE: Duration = Duration::from_secs(5);

/// A tick of a scene that four sessions write, beside one session in a scene of its own.
#[derive(Clone, Copy, Parser)]
struct Size {
    /// Boxes of a writer
    #[arg(long, default_value_t = 25_000)]
    boxes: u32,
    #[arg(long, default_value_t = 200)]
    ticks: u64,
    #[arg(long)]
    json: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Where a box is in a tick: on a lattice, with neighbours of other writers.
fn box_at(index: u32, tick: u64, boxes: u32) -> Aabb {
    let side = f64::from(boxes * WRITERS).cbrt().ceil() as u32;
    let cell = index % boxes * WRITERS + index / boxes;
    let shift = 0.3 * (0.37 * tick as f32 + index as f32).sin();
    let at = [cell % side, cell / side % side, cell / side / side].map(|c| c as f32 + shift);
    Aabb::new(at, at.map(|x| x + 0.8))
}

/// The indices of a range that move in a tick.
fn moving(range: std::ops::Range<u32>, tick: u64, share: u32) -> Vec<u32> {
    range.filter(|index| (u64::from(*index) * 37 + tick) % 100 < u64::from(share)).collect()
}

fn commit(scene: &mut Scene, indices: &[u32], boxes: &[Aabb]) -> Result<(), pairmask::Error> {
    let answer = scene.edit().set_all(indices, boxes).commit(Report::Changes)?;
    black_box((answer.begun().len(), answer.ended().count()));
    Ok(())
}

/// Where writers meet that are about to commit, awake. A thread that cannot have a core of its own lets others run.
#[derive(Default)]
struct Line(AtomicU64);

impl Line {
    fn wait(&self, tick: u64) {
        let all = (tick + 1) * u64::from(WRITERS);
        self.0.fetch_add(1, Ordering::AcqRel);
        for spins in 0u32.. {
            if self.0.load(Ordering::Acquire) >= all {
                return;
            }
            if spins % 1_000 == 999 {
                std::thread::yield_now();
            } else {
                std::hint::spin_loop();
            }
        }
    }
}

/// When the first writer began and when the last one ended, of one tick, ns since an instant.
struct Span {
    first: AtomicU64,
    last: AtomicU64,
}

impl Span {
    fn note(&self, since: Instant, begin: Instant) {
        let ns = |at: Instant| at.duration_since(since).as_nanos() as u64;
        self.first.fetch_min(ns(begin), Ordering::AcqRel);
        self.last.fetch_max(ns(Instant::now()), Ordering::AcqRel);
    }

    /// Its length in µs; the next tick begins with none.
    fn take_us(&self) -> f64 {
        let first = self.first.swap(u64::MAX, Ordering::AcqRel);
        (self.last.swap(0, Ordering::AcqRel) - first) as f64 / 1e3
    }
}

/// Ticks of the shared scene and of one scene, in turns: the times of both.
fn measure(
    daemon: &PrivateDaemon,
    Size { boxes, ticks, .. }: Size,
    share: u32,
) -> Result<[Vec<f64>; 2], Box<dyn Error>> {
    let begins = Barrier::new(WRITERS as usize + 1);
    let ends = Barrier::new(WRITERS as usize + 1);
    let rests = Barrier::new(WRITERS as usize + 1);
    let (line, since) = (Line::default(), Instant::now());
    let span = Span { first: AtomicU64::new(u64::MAX), last: AtomicU64::new(0) };
    let has_failed = AtomicBool::new(false);
    let options = SceneOptions::default().with_tick_deadline(DEADLINE);
    let mut writers = Vec::new();
    for which in 0..WRITERS {
        let mut session = daemon.session().connect()?;
        let mut scene = session.scene(options.clone().with_shared(format!("bench-{share}")))?;
        scene.lease(which * boxes..(which + 1) * boxes)?;
        writers.push((which, session, scene));
    }
    let mut session = daemon.session().connect()?;
    let mut alone = session.scene(SceneOptions::default())?;
    let mut times = [Vec::new(), Vec::new()];
    std::thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        for (which, session, mut scene) in writers {
            let (begins, ends, has_failed) = (&begins, &ends, &has_failed);
            let (line, span, rests) = (&line, &span, &rests);
            scope.spawn(move || {
                let own = which * boxes..(which + 1) * boxes;
                for tick in 0..ticks + WARM_UP {
                    let share = if tick == 0 { 100 } else { share };
                    let indices = moving(own.clone(), tick, share);
                    let moved: Vec<Aabb> =
                        indices.iter().map(|index| box_at(*index, tick, boxes)).collect();
                    begins.wait();
                    line.wait(tick);
                    let begin = Instant::now();
                    if let Err(error) = commit(&mut scene, &indices, &moved) {
                        eprintln!("{error}");
                        has_failed.store(true, Ordering::Relaxed);
                    }
                    span.note(since, begin);
                    ends.wait();
                    // Nobody works beside the one scene.
                    rests.wait();
                }
                drop((scene, session));
            });
        }
        let mut failed = None;
        for tick in 0..ticks + WARM_UP {
            let share = if tick == 0 { 100 } else { share };
            let indices = moving(0..WRITERS * boxes, tick, share);
            let moved: Vec<Aabb> =
                indices.iter().map(|index| box_at(*index, tick, boxes)).collect();
            begins.wait();
            ends.wait();
            let shared = span.take_us();
            let start = Instant::now();
            // The writers wait for this thread at all barriers.
            failed = commit(&mut alone, &indices, &moved).err().or(failed);
            let took = start.elapsed().as_secs_f64() * 1e6;
            rests.wait();
            if tick >= WARM_UP {
                times[0].push(shared);
                times[1].push(took);
            }
        }
        failed.map_or(Ok(()), |error| Err(error.into()))
    })?;
    if has_failed.load(Ordering::Relaxed) { Err("a commit failed".into()) } else { Ok(times) }
}

fn main() -> Result<(), Box<dyn Error>> {
    let size = Size::parse();
    let daemon = measure::daemon(GpuChoice::default())?;
    if !size.json {
        println!("moving   shared p50     p99   alone p50     p99   ratio of p50");
    }
    let mut rows = Vec::new();
    for share in SHARES {
        let times = measure(&daemon, size, share)?;
        let [[s50, s99], [a50, a99]] =
            times.map(|times| [0.5, 0.99].map(|share| percentile(&times, share)));
        if size.json {
            rows.push(serde_json::json!({
                "moving_percent": share, "writers": WRITERS, "boxes": size.boxes,
                "shared_us": { "p50": s50, "p99": s99 }, "alone_us": { "p50": a50, "p99": a99 },
            }));
        } else {
            let ratio = s50 / a50;
            println!("{share:5} % {s50:11.0} {s99:7.0} {a50:11.0} {a99:7.0} {ratio:10.2}");
        }
    }
    if size.json {
        println!("{}", serde_json::json!({ "rows": rows }));
    }
    daemon.stop();
    Ok(())
}
