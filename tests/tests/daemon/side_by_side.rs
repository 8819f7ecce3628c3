//! Many clients at once: each gets its own pairs, none is held up by another that asks for much, takes no
//! answers or dies.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::sleep;
use std::time::Duration;

use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::prelude::*;

struct Scene {
    boxes: Vec<Aabb>,
    pairs: Vec<[u32; 2]>,
}

impl Scene {
    fn new(n: u32, seed: u64) -> Self {
        let boxes = stress_scenes::named("uniform").boxes(n, seed);
        let pairs = oracle::truth(&boxes).pairs;
        Self { boxes, pairs }
    }

    fn check(&self, session: &mut Session) {
        let pairs = session.answer(&self.boxes).sorted();
        // Not `assert_eq`, which would print thousands of pairs.
        assert!(pairs == self.pairs, "wrong pairs of {} boxes", self.boxes.len());
    }
}

const ROUNDS: usize = 3;

/// Scenes of eight clients: five with all sizes up to 70, each beginning at another, two with 1,000 and
/// odd numbers near it, one with a large one.
fn scenes_of_eight() -> Vec<Vec<Scene>> {
    let small = |client: u32| {
        (0..=70).map(|i| Scene::new((i + 14 * client) % 71, u64::from(client))).collect()
    };
    let mut clients: Vec<Vec<Scene>> = (0..5).map(small).collect();
    clients.push([1_000, 999, 345].map(|n| Scene::new(n, 5)).into());
    clients.push([1_234, 1_000, 64].map(|n| Scene::new(n, 6)).into());
    clients.push([30_000, 7, 20_001].map(|n| Scene::new(n, 7)).into());
    clients
}

#[test]
fn eight_clients_at_once_get_their_own_pairs() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let clients = scenes_of_eight();
    let frames: u64 = clients.iter().map(|scenes| (ROUNDS * scenes.len()) as u64).sum();
    std::thread::scope(|scope| {
        for scenes in &clients {
            let mut session = daemon.connect();
            scope.spawn(move || {
                for _ in 0..ROUNDS {
                    for scene in scenes {
                        scene.check(&mut session);
                    }
                }
            });
        }
    });
    let mut session = daemon.connect();
    let status = session.daemon_status().unwrap();
    assert_eq!((status.frames, status.errors), (frames, 0));
    daemon.audit_is_clean(|audit| audit.frames > 0 && audit.frames + audit.skipped == frames);
}

/// Starts a client in a mode that goes on until it is killed: a process of its own, since the tests' threads are one
/// process to the daemon.
fn start(daemon: &TestDaemon, mode: &str) -> FaultClient {
    let mut other = FaultClient::start(daemon, &[mode, "auto"]);
    other.go();
    other
}

/// A client that always has as many large frames waiting as it may does not hold up one with small
/// frames. With a turn each, the other would get one request served for each large frame. The median of three
/// daemons: beside one in forty, the system leaves a small frame no core for a quarter of a second, where there are
/// two, both spun on and computed on.
#[test]
fn a_greedy_client_leaves_the_others_their_share() {
    let mut rounds = [(); 3].map(|()| small_frames_beside_ten_large_ones());
    rounds.sort_unstable();
    println!("small frames beside 10 large ones: {rounds:?}");
    // Two requests each: the frame and the status.
    assert!(2 * rounds[1] >= 30, "small frames beside 10 large ones: {rounds:?}");
}

fn small_frames_beside_ten_large_ones() -> u64 {
    let daemon = TestDaemon::of_cores();
    let scene = Scene::new(100, 1);
    let mut session = daemon.connect();
    scene.check(&mut session);
    let _greedy = start(&daemon, "greedy");
    // The boxes that were answered distinguish the greedy client's frames from ours.
    let mut boxes = || {
        scene.check(&mut session);
        session.daemon_status().unwrap().boxes
    };
    let begun = boxes();
    let mut ours = 1;
    let greedy_frames = |boxes: u64, ours: u64| (boxes - begun - 100 * (ours - 1)) / GREEDY_BOXES;
    loop {
        ours += 1;
        if greedy_frames(boxes(), ours) >= 10 {
            return ours;
        }
    }
}

/// Boxes of a greedy client's frame, as `fault_client` has it.
const GREEDY_BOXES: u64 = 600_000;

/// A frame that takes long, which its number of boxes does not show, leaves a thread that answers the others: a client
/// of small frames gets many answers meanwhile, each time.
#[test]
fn a_pile_of_boxes_does_not_hold_up_small_frames() {
    let daemon = TestDaemon::of_cores();
    let scene = Scene::new(200, 1);
    let mut session = daemon.connect();
    scene.check(&mut session);
    let rounds = [(); PILES].map(|()| {
        let mut pile = start(&daemon, "pile");
        let (is_answered, mut frames) = (AtomicBool::new(false), 0);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let _answered = SetWhenDropped(&is_answered);
                assert_eq!(pile.next_line(), "answered");
            });
            while !is_answered.load(Ordering::Relaxed) {
                scene.check(&mut session);
                frames += 1;
                // A game's client: threads of the daemon go to sleep between its frames.
                sleep(Duration::from_millis(5));
            }
        });
        frames
    });
    let are_enough = rounds.iter().all(|frames| *frames >= 10);
    assert!(are_enough, "small frames beside a pile each: {rounds:?}");
}

/// Piles in a row.
const PILES: usize = 4;

/// A client that takes no answers keeps nothing but its own memory.
#[test]
fn a_hung_client_does_not_hold_up_the_others() {
    let daemon = TestDaemon::of_cores();
    let _hung: Vec<FaultClient> = (0..3).map(|_| start(&daemon, "pending")).collect();
    let scenes: Vec<Scene> = (0..4).map(|seed| Scene::new(300 + 7 * seed, seed.into())).collect();
    let worker = daemon.worker();
    std::thread::scope(|scope| {
        for scene in &scenes {
            let mut session = daemon.connect();
            scope.spawn(move || (0..200).for_each(|_| scene.check(&mut session)));
        }
    });
    assert_eq!(daemon.worker(), worker);
}

/// Frames that are dropped unread, answered or not, take neither room nor an answer from the next one,
/// however late its client looks.
#[test]
fn frames_dropped_unread_take_nothing_from_the_next() {
    let (_daemon, mut session) = served();
    let scenes: Vec<Scene> = (0..3).map(|seed| Scene::new(200 + 35 * seed, seed.into())).collect();
    for round in 0..400 {
        let scene = &scenes[round % scenes.len()];
        for unread in 0..round % 6 {
            let pending = session.ask(&scene.boxes);
            if (round + unread) % 4 == 0 {
                sleep(Duration::from_micros(500));
            }
            drop(pending);
        }
        let pending = session.ask(&scene.boxes);
        if round % 3 == 0 {
            sleep(Duration::from_millis(1));
        }
        let pairs = pending.wait().unwrap().sorted();
        assert!(pairs == scene.pairs, "round {round}");
    }
}

/// Ends the threads of a test, after a panic too.
struct SetWhenDropped<'a>(&'a AtomicBool);

impl Drop for SetWhenDropped<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Clients that die in the middle of frame after frame, beside others that go on.
#[test]
fn clients_killed_under_load_leave_the_daemon_serving() {
    // The daemon notices it a moment later.
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-clients", "64"]);
    let worker = daemon.worker();
    let (stop, answered) = (AtomicBool::new(false), AtomicU64::new(0));
    let scenes: Vec<Scene> = (0..3).map(|seed| Scene::new(500 + seed, seed.into())).collect();
    std::thread::scope(|scope| {
        for scene in &scenes {
            let mut session = daemon.connect();
            let (stop, answered) = (&stop, &answered);
            scope.spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    scene.check(&mut session);
                    answered.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        let _stop = SetWhenDropped(&stop);
        for round in 0..12 {
            let victims = ["load", "greedy", "load"].map(|mode| start(&daemon, mode));
            let so_far = answered.load(Ordering::Relaxed);
            until("frames are answered beside the victims", || {
                answered.load(Ordering::Relaxed) > so_far + 5 + 3 * round
            });
            drop(victims);
        }
        let so_far = answered.load(Ordering::Relaxed);
        until("frames are answered after they died", || {
            answered.load(Ordering::Relaxed) > so_far + 20
        });
    });
    assert_eq!(daemon.worker(), worker, "no client takes the worker with it");
}
