//! `--max-memory`: clients that take all that they can are refused, and the others are served.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use pairmask::SceneOptions;
use pairmask_core::aabb::AABB_BYTES;
use pairmask_tests::attack_time;
use pairmask_tests::attackers::raw::{self, RawClient};
use pairmask_tests::prelude::*;
use pairmask_wire::{PAGE_BYTES, ReplyError, StatusCode};
use rustix::fs::fstat;
use rustix::process::Pid;

const MIB: u64 = 1 << 20;

/// Boxes of some pairs, or all in one place.
fn row(n: u32, step: f32) -> Vec<Aabb> {
    let at = |x: f32| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
    (0..n).map(|i| at(step * i as f32)).collect()
}

/// Whether something was refused for the memory that it takes. Another error is a fault.
fn is_refused<T>(done: Result<T, Error>) -> bool {
    match done {
        Ok(_) => false,
        Err(Error::Reply(ReplyError::Status { status: StatusCode::OverBudget, .. })) => true,
        Err(error) => panic!("{error}"),
    }
}

/// A client that takes ever more, until all of them are to end.
struct Greedy<'a> {
    session: Session,
    is_over: &'a AtomicBool,
    refusals: &'a AtomicU64,
}

impl Greedy<'_> {
    fn goes_on(&self) -> bool {
        !self.is_over.load(Ordering::Relaxed)
    }

    /// Whether it is to take no more for now: it was refused, or is to end.
    fn is_stopped<T>(&self, done: Result<T, Error>) -> bool {
        let is_refused = is_refused(done);
        self.refusals.fetch_add(u64::from(is_refused), Ordering::Relaxed);
        is_refused || !self.goes_on()
    }

    /// A scene that grows until it may not.
    fn grow_a_scene(&mut self) {
        let boxes = row(20_000, 0.7);
        while self.goes_on() {
            let mut scene = self.session.scene(SceneOptions::default()).unwrap();
            for part in 0.. {
                let indices = 20_000 * part..20_000 * (part + 1);
                let edit = scene.edit().set_all(indices, &boxes);
                if self.is_stopped(edit.commit(Report::Changes)) {
                    break;
                }
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Frames that double until they may not, with masks that are held.
    fn grow_frames(&mut self, step: f32) {
        while self.goes_on() {
            let mut held = Vec::new();
            for power in 10..23 {
                let mask = self.session.ask(&row(1 << power, step)).wait();
                let mask = mask.map(|mask| held.push(mask));
                held.drain(..held.len().saturating_sub(2));
                if self.is_stopped(mask) {
                    break;
                }
            }
        }
    }

    /// Queries that find more and more pairs of a scene.
    fn grow_queries(&mut self) {
        let boxes = row(20_000, 0.0);
        while self.goes_on() {
            let mut scene = self.session.scene(SceneOptions::default()).unwrap();
            let filled = scene.edit().set_all(0..2_000, &boxes[..2_000]).commit(Report::Nothing);
            if self.is_stopped(filled) {
                std::thread::sleep(Duration::from_millis(20));
                continue;
            }
            for queries in (500..20_000).step_by(500) {
                if self.is_stopped(scene.query(&boxes[..queries])) {
                    break;
                }
            }
        }
    }
}

/// Has others end with the thread that goes on beside them, also where that panics.
struct Until<'a>(&'a AtomicBool);

impl Drop for Until<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Bytes of a process that no file is behind.
fn own_bytes(process: Pid) -> u64 {
    let sizes = format!("/proc/{}/statm", process.as_raw_nonzero());
    let sizes = std::fs::read_to_string(sizes).unwrap();
    let pages: Vec<u64> = sizes.split(' ').map(|n| n.trim().parse().unwrap()).collect();
    (pages[1] - pages[2]) * rustix::param::page_size() as u64
}

#[test]
fn ten_greedy_clients_are_held_to_the_memory_that_there_may_be() {
    /// How long a slow host may take until each of them has been refused.
    const LATEST: Duration = Duration::from_secs(60);
    let limit = 512 * MIB;
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "512M"]);
    let is_over = AtomicBool::new(false);
    let counts: [AtomicU64; 10] = std::array::from_fn(|_| AtomicU64::new(0));
    let refusals = || counts.each_ref();
    let (mut most, mut frames) = (0, 0);
    std::thread::scope(|scope| {
        let until = Until(&is_over);
        for (number, refusals) in refusals().into_iter().enumerate() {
            let session = daemon.session().deadline(TIMEOUT).connect().unwrap();
            let mut client = Greedy { session, is_over: &is_over, refusals };
            scope.spawn(move || match number % 4 {
                0 => client.grow_a_scene(),
                1 => client.grow_frames(0.7),
                2 => client.grow_frames(0.0),
                _ => client.grow_queries(),
            });
        }
        let mut session = daemon.session().deadline(TIMEOUT).connect().unwrap();
        let (boxes, begin) = (row(1_000, 0.7), Instant::now());
        let is_refused = |count: &AtomicU64| count.load(Ordering::Relaxed) > 0;
        while begin.elapsed() < 2 * attack_time()
            || begin.elapsed() < LATEST && !refusals().into_iter().all(is_refused)
        {
            // What is kept for it is enough.
            let mask = session.ask(&boxes).wait().unwrap();
            assert_eq!((mask.info().served_by, mask.count()), (ServedBy::Daemon, 999));
            frames += 1;
            most = most.max(own_bytes(daemon.worker()) + daemon.shared_bytes());
        }
        drop(until);
    });
    let refusals = refusals().map(|count| count.load(Ordering::Relaxed));
    println!("{frames} frames of a small client, {refusals:?} refusals, {} MiB", most / MIB);
    assert!(refusals.iter().all(|refused| *refused > 0), "{refusals:?}");
    assert!((limit / 4..limit).contains(&most), "{} of {} MiB", most / MIB, limit / MIB);
}

/// A shared scene that one client fills takes nothing that others' shared scenes are sure of.
#[test]
fn a_shared_scene_counts_as_who_opened_it() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "512M"]);
    let [mut greedy, mut second, mut small] = [(); 3].map(|()| daemon.connect());
    let shared = |session: &mut Session, name: &str| {
        session.scene(SceneOptions::default().with_shared(name)).unwrap()
    };
    let fill = |session: &mut Session, name: &str| {
        let (mut scene, boxes) = (shared(session, name), row(20_000, 0.7));
        let mut part = 0;
        loop {
            let indices = 20_000 * part..20_000 * (part + 1);
            scene.lease(indices.clone()).unwrap();
            if is_refused(scene.edit().set_all(indices, &boxes).commit(Report::Nothing)) {
                return (scene, part);
            }
            part += 1;
        }
    };
    let (filled, parts) = fill(&mut greedy, "greedy");
    assert!(is_refused(greedy.ask(&row(1_000_000, 0.7)).wait()), "its own frames are refused");
    let (_second, others) = fill(&mut second, "second");
    assert!(parts > others && others > 0, "{parts} and {others}");
    let mut scene = shared(&mut small, "small");
    scene.lease(0..1_000).unwrap();
    let boxes = row(1_000, 0.7);
    let edit = scene.edit().set_all(0..1_000, &boxes);
    assert_eq!(edit.commit(Report::All).unwrap().pairs().len(), 999);
    // Who opened it leaves, and another one goes on with it.
    let mut joined = shared(&mut small, "greedy");
    drop((filled, greedy));
    let indices = joined.lease_any(1_000).unwrap();
    eventually("there is room again", || {
        let edit = joined.edit().set_all(indices.clone(), &boxes);
        (!is_refused(edit.commit(Report::Changes))).then_some(())
    });
}

/// Frames of so many boxes, each in another hole of a file: how many were answered, refused, and the bytes that are there
/// at the end.
fn read_holes(daemon: &TestDaemon, n: u32, frames: u64, pause: Duration) -> (u32, u32, u64) {
    // A GiB for each place, of which nothing is there.
    let client = RawClient::connect_at(&daemon.dir(), (1024 * MIB) as usize / PAGE_BYTES).unwrap();
    let pages = (u64::from(n) * AABB_BYTES as u64).div_ceil(PAGE_BYTES as u64);
    let (mut answered, mut refused) = (0, 0);
    for number in 0..frames {
        let mut loan = client.loan().unwrap();
        loan.header = raw::cull(number, n, EngineChoice::Auto);
        loan.placed.offset += number * pages * PAGE_BYTES as u64;
        loan.placed.pages = pages;
        let header = client.send(loan).answer(TIMEOUT).unwrap();
        match StatusCode::from_wire(header.status) {
            Some(StatusCode::Ok) => answered += 1,
            Some(StatusCode::OverBudget) => refused += 1,
            status => panic!("{status:?}"),
        }
        std::thread::sleep(pause);
    }
    let there = fstat(&client.memory.file).unwrap().st_blocks as u64 * 512;
    (answered, refused, there)
}

/// Boxes in a hole of a file: to read them would fill it with memory of the daemon's.
#[test]
fn holes_are_not_filled_beyond_what_their_client_may_take() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "64M"]);
    let worker = daemon.worker();
    let (answered, refused, there) = read_holes(&daemon, 3_000, 800, Duration::ZERO);
    assert!(answered > 100 && refused > 100, "{answered} answered, {refused} refused");
    assert!((8 * MIB..33 * MIB).contains(&there), "{} MiB", there / MIB);
    // Long enough for the daemon to look several times how much there is.
    let (_, refused, there) = read_holes(&daemon, 100_000, 60, Duration::from_millis(40));
    assert_eq!(refused, 60, "all boxes are in one place");
    assert!(there < 33 * MIB, "{} MiB", there / MIB);
    assert_eq!(daemon.worker(), worker, "the worker lives");
    let mask = daemon.connect().ask(&row(1_000, 0.7)).wait().unwrap();
    assert_eq!(mask.count(), 999);
}

#[test]
fn a_client_whose_frame_was_too_large_goes_on() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "64M"]);
    let mut session = daemon.connect();
    for n in [1_500_000, 300_000, 2_000_000] {
        assert_eq!(session.ask(&row(100, 0.7)).wait().unwrap().count(), 99);
        assert!(is_refused(session.ask(&row(n, 0.7)).wait()), "{n} boxes");
        assert_eq!(session.ask(&row(100, 0.7)).wait().unwrap().count(), 99, "after {n} boxes");
    }
}
