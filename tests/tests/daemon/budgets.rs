//! `--max-memory`: clients that take all that they can are refused, and the others are served.

use std::sync::atomic::{AtomicBool, Ordering};
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

/// A scene that grows until it may not.
fn grow_a_scene(session: &mut Session, goes_on: &dyn Fn() -> bool) -> u64 {
    let (boxes, mut refusals) = (row(20_000, 0.7), 0);
    while goes_on() {
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        for part in 0.. {
            let indices = 20_000 * part..20_000 * (part + 1);
            let edit = scene.edit().set_all(indices, &boxes);
            if !goes_on() || is_refused(edit.commit(Report::Changes)) {
                break;
            }
        }
        refusals += u64::from(goes_on());
        std::thread::sleep(Duration::from_millis(20));
    }
    refusals
}

/// Frames that double until they may not, with masks that are held.
fn grow_frames(session: &mut Session, step: f32, goes_on: &dyn Fn() -> bool) -> u64 {
    let mut refusals = 0;
    while goes_on() {
        let mut held = Vec::new();
        for power in 10..23 {
            let mask = session.ask(&row(1 << power, step)).wait();
            let mask = mask.map(|mask| held.push(mask));
            held.drain(..held.len().saturating_sub(2));
            if !goes_on() || is_refused(mask) {
                break;
            }
        }
        refusals += u64::from(goes_on());
    }
    refusals
}

/// Queries that find more and more pairs of a scene.
fn grow_queries(session: &mut Session, goes_on: &dyn Fn() -> bool) -> u64 {
    let boxes = row(20_000, 0.0);
    let mut refusals = 0;
    while goes_on() {
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        let filled = scene.edit().set_all(0..2_000, &boxes[..2_000]).commit(Report::Nothing);
        if is_refused(filled) {
            refusals += 1;
            std::thread::sleep(Duration::from_millis(20));
            continue;
        }
        for queries in (500..20_000).step_by(500) {
            if !goes_on() || is_refused(scene.query(&boxes[..queries])) {
                break;
            }
        }
        refusals += u64::from(goes_on());
    }
    refusals
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
    let limit = 512 * MIB;
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "512M"]);
    let is_over = AtomicBool::new(false);
    let goes_on = || !is_over.load(Ordering::Relaxed);
    let (mut most, mut frames) = (0, 0);
    let refusals = std::thread::scope(|scope| {
        let until = Until(&is_over);
        let start = |number: usize| {
            let mut session = daemon.session().deadline(TIMEOUT).connect().unwrap();
            let goes_on = &goes_on;
            scope.spawn(move || match number % 4 {
                0 => grow_a_scene(&mut session, goes_on),
                1 => grow_frames(&mut session, 0.7, goes_on),
                2 => grow_frames(&mut session, 0.0, goes_on),
                _ => grow_queries(&mut session, goes_on),
            })
        };
        let greedy: Vec<_> = (0..10).map(start).collect();
        let mut session = daemon.session().deadline(TIMEOUT).connect().unwrap();
        let boxes = row(1_000, 0.7);
        let end = Instant::now() + 2 * attack_time();
        while Instant::now() < end {
            // What is kept for it is enough.
            let mask = session.ask(&boxes).wait().unwrap();
            assert_eq!((mask.info().served_by, mask.count()), (ServedBy::Daemon, 999));
            frames += 1;
            most = most.max(own_bytes(daemon.worker()) + daemon.shared_bytes());
        }
        drop(until);
        greedy.into_iter().map(|client| client.join().unwrap()).collect::<Vec<u64>>()
    });
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
