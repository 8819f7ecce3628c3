//! Steady frames allocate nothing on the heap: client, daemon and in process.
#![allow(unsafe_code, clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ops::RangeInclusive;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use pairmask_tests::prelude::*;
use pairmask_tests::spheres::whole_scene;
use pairmask_wire::InstanceName;
use rustix::process::{getpid, kill_process};

/// Counts allocations of marked threads while counting is on.
struct Counting;

static ON: AtomicBool = AtomicBool::new(false);
static COUNT: AtomicU64 = AtomicU64::new(0);
thread_local! {
    static MARKED: Cell<bool> = const { Cell::new(false) };
}

fn note() {
    if ON.load(Ordering::Relaxed) && MARKED.try_with(Cell::get).unwrap_or(false) {
        COUNT.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: every call goes to the system allocator unchanged; counting touches no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(memory, layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        note();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(memory, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Frames that are counted in a run: few, so that on a busy machine too some runs are over before the daemon does what
/// it does now and then, which allocates.
const FRAMES: usize = 50;

fn counted(work: impl FnOnce()) -> u64 {
    let before = COUNT.load(Ordering::Relaxed);
    ON.store(true, Ordering::Relaxed);
    work();
    ON.store(false, Ordering::Relaxed);
    COUNT.load(Ordering::Relaxed) - before
}

/// Runs of which one counts. On a busy machine the pool's queues grow in several of them.
const RUNS: usize = 32;

/// Allocations of runs of `work`, up to the first that are as expected. An allocation in every frame shows in
/// all runs; growth of the pool's queues, which happens when work is stolen, in some, and in some more frames
/// fall to another lane than the daemon's first, and are not counted.
fn until_steady(expected: &RangeInclusive<u64>, mut work: impl FnMut()) -> Vec<u64> {
    let mut runs = vec![counted(&mut work)];
    while runs.len() < RUNS && !runs.last().is_some_and(|run| expected.contains(run)) {
        runs.push(counted(&mut work));
    }
    runs
}

/// So many allocations, all or nearly all by the lane that is counted, and up to some that a busy machine adds.
const fn nearly(expected: u64, more_when_busy: u64) -> RangeInclusive<u64> {
    expected - expected / 10..=expected + more_when_busy
}

/// Asks for frame after frame by the number of each, and counts their pairs.
fn frames(count: usize, mut submit: impl FnMut(usize) -> Pending<PairMask>) -> u64 {
    let mut pairs = 0;
    for i in 0..count {
        submit(i).wait().unwrap().pairs().for_each(|[a, b]| pairs += u64::from(a < b));
    }
    pairs
}

/// Whether frames are steady: they find pairs, and allocate what is expected.
fn check(
    what: &str,
    expected: &RangeInclusive<u64>,
    mut submit: impl FnMut(usize) -> Pending<PairMask>,
) {
    frames(20, &mut submit);
    let mut pairs = 0;
    let runs = until_steady(expected, || pairs = frames(FRAMES, &mut submit));
    assert!(pairs > 0);
    assert!(runs.last().is_some_and(|run| expected.contains(run)), "{runs:?}: {what}");
}

/// One test: counter and signal handlers are one for the process.
#[test]
fn steady_frames_allocate_nothing() {
    let _alone = crate::alone();
    MARKED.set(true);
    assert!(counted(|| drop(std::hint::black_box(vec![1u8; 100]))) > 0, "the counter counts");

    let dir = tempfile::tempdir().unwrap();
    // Longer than any pause.
    let mut settings = crate::settings(dir.path());
    settings.daemon.spin = Duration::from_secs(1);
    let runtime_dir = settings.dir.clone();
    let daemon = std::thread::spawn(move || {
        MARKED.set(true);
        crate::serve(&settings)
    });
    eventually("the daemon serves", || runtime_dir.read_record(&InstanceName::default()));

    let scenes: Vec<_> =
        (0..4).map(|seed| stress_scenes::named("uniform").boxes(1000, seed)).collect();
    let spheres: Vec<_> = (0..4).map(|seed| whole_scene(1000, 25, seed).0).collect();
    let bounds = Bounds::new([0.0; 3], [100.0; 3]).unwrap();
    let precisions = [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16];
    for backend in [Backend::InProcess, Backend::Daemon] {
        for encoding in Encoding::ALL {
            // In process, one thread: a pool takes work from outside through a queue of rayon's
            // that allocates a block every 63 frames. The daemon's frames start within its pool.
            let threads = if backend == Backend::Daemon { 2 } else { 1 };
            let builder = Session::builder()
                .runtime_dir(runtime_dir.clone())
                .backend(backend)
                .threads(threads)
                .encoding(EncodingChoice::Only(encoding));
            let what = format!("{backend}, {encoding}");
            let mut session = builder.clone().connect().unwrap();
            let alone = nearly(0, 0);
            check(&what, &alone, |i| session.ask(&scenes[i % scenes.len()]));
            check(&format!("{what}, narrow"), &alone, |i| {
                session.ask_narrow(&scenes[i % scenes.len()], precisions[i % 3])
            });
            drop(session);
            for engine in [EngineName::CpuBrute, EngineName::CpuGrid] {
                let mut session =
                    builder.clone().engine(EngineChoice::Only(engine)).connect().unwrap();
                // All pairs of so many spheres are worth two threads: the second one is called by a job of rayon's. Where
                // it comes late, the next frame makes another team, or calls it anew.
                let is_shared = threads > 1 && engine == EngineName::CpuBrute;
                let calls = if is_shared { FRAMES as u64 } else { 0 };
                check(&format!("{what}, {engine}, spheres"), &nearly(calls, calls), |i| {
                    session.ask_spheres(&spheres[i % spheres.len()])
                });
            }
        }
    }
    kill_process(getpid(), Signal::TERM).unwrap();
    daemon.join().unwrap().unwrap();
}
