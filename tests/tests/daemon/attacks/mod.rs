//! Attacks, repeated for two seconds each or for `PAIRMASK_ATTACK_SECONDS`. Regardless of what an attacker
//! writes to memory that it has mapped, honest clients beside it get right answers, and the
//! instance serves again.
//!
//! Each test prints its counts (`--nocapture`).

mod daemons;

use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::os::fd::AsRawFd;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use pairmask::{SceneEdit, SceneOptions};
use pairmask_tests::attack_time;
use pairmask_tests::attackers::raw::{self, Memory, RawClient, write};
use pairmask_tests::attackers::shared::SHARED_SCENE;
use pairmask_tests::daemon::program;
use pairmask_tests::filtered_frames::{FilteredFrame, KINDS};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{Edits, Grouped, Kind, SessionScene, hold};
use rustix::fs::{MemfdFlags, ftruncate, memfd_create};

fn scene(n: u32, seed: u64) -> Vec<Aabb> {
    stress_scenes::named("uniform").boxes(n, seed)
}

struct Attacker {
    process: Child,
    mode: &'static str,
}

impl Attacker {
    fn start(dir: &std::path::Path, mode: &'static str) -> Self {
        let process = Command::new(program("attacker"))
            .arg(mode)
            .env("PAIRMASK_RUNTIME_DIR", dir)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        Self { process, mode }
    }

    fn end(mut self) -> BTreeMap<String, u64> {
        drop(self.process.stdin.take());
        let mut said = String::new();
        self.process.stdout.take().unwrap().read_to_string(&mut said).unwrap();
        let status = self.process.wait().unwrap();
        assert!(status.success(), "attacker '{}': {status}", self.mode);
        let counts = said.lines().map(|line| line.split_once('=').unwrap());
        counts.map(|(name, count)| (name.to_owned(), count.parse().unwrap())).collect()
    }
}

impl Drop for Attacker {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Frames that are asked for in turn, with their pairs.
struct InTurn {
    frames: Vec<(Vec<Aabb>, Vec<Pair>)>,
    asked: usize,
}

impl InTurn {
    fn new(sizes: &[u32]) -> Self {
        let with_pairs = |(seed, n): (usize, &u32)| {
            let boxes = scene(*n, seed as u64);
            let pairs = oracle::truth(&boxes).pairs;
            (boxes, pairs)
        };
        Self { frames: sizes.iter().enumerate().map(with_pairs).collect(), asked: 0 }
    }

    fn check(&mut self, session: &mut Session) -> Result<ServedBy, Error> {
        let (boxes, expected) = &self.frames[self.asked % self.frames.len()];
        self.asked += 1;
        let mask = session.ask(boxes).wait()?;
        assert!(mask.sorted() == *expected, "wrong answer {} of {} boxes", self.asked, boxes.len());
        Ok(mask.info().served_by)
    }

    fn come_back(&mut self, session: &mut Session) {
        until("the daemon serves again", || self.check(session).unwrap() == ServedBy::Daemon);
    }
}

#[derive(Debug, Default)]
struct Lived {
    there: u64,
    here: u64,
    restarts: u64,
}

/// Submits frames from a session that falls back, as long as the attacks last, and checks that
/// every answer is right. Waits until the daemon serves again after the attacks.
fn live_beside(mode: &'static str) -> (BTreeMap<String, u64>, Lived) {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-clients", "16"]);
    let mut session = daemon.connect_auto();
    let mut frames = InTurn::new(&[64, 500, 1500]);
    let mut lived = Lived::default();
    let mut worker = daemon.worker();
    let attacker = Attacker::start(daemon.path(), mode);
    let end = Instant::now() + attack_time();
    while Instant::now() < end {
        match frames.check(&mut session).unwrap() {
            ServedBy::Daemon => lived.there += 1,
            ServedBy::InProcess => lived.here += 1,
        }
        if let Some(record) = daemon.record()
            && record.worker_pid != worker.as_raw_nonzero().get() as u32
        {
            worker = daemon.worker();
            lived.restarts += 1;
        }
    }
    let counts = attacker.end();
    frames.come_back(&mut session);
    println!("{mode}: {lived:?}, attacker {counts:?}");
    (counts, lived)
}

#[test]
fn lengths_beyond_a_segment_are_refused_and_kill_no_process() {
    let (counts, lived) = live_beside("lengths");
    assert!(counts["rounds"] > 10, "{counts:?}");
    assert_eq!(counts.get("outside"), None, "answered over memory of others: {counts:?}");
    assert_eq!((lived.restarts, lived.here), (0, 0), "{lived:?}");
}

/// Does what an honest client does, again and again, beside a client that forges requests in a mode.
fn honest_beside(daemon: &TestDaemon, mode: &'static str, mut honest: impl FnMut()) {
    let (worker, begin, mut counts) = (daemon.worker(), Instant::now(), BTreeMap::new());
    let is_enough = |counts: &BTreeMap<String, u64>| {
        ["answered", "refused"].iter().all(|name| counts.get(*name).is_some_and(|n| *n > 10))
    };
    // How much an attacker comes to do goes by the machine: as many attackers as it takes, one after the other.
    while !is_enough(&counts) {
        assert!(begin.elapsed() < attack_time() + TIMEOUT, "{counts:?}");
        let attacker = Attacker::start(daemon.path(), mode);
        let end = Instant::now() + attack_time();
        while Instant::now() < end {
            honest();
        }
        for (name, count) in attacker.end() {
            *counts.entry(name).or_insert(0) += count;
        }
    }
    println!("{mode}: {counts:?}");
    assert_eq!(daemon.worker(), worker, "the worker lives");
}

/// Scenes of an honest client, held to the model, beside a client that forges edits.
#[test]
fn forged_edits_leave_the_scenes_of_others_alone() {
    let (daemon, mut session) = served();
    let mut seed = 0;
    honest_beside(&daemon, "edits", || {
        seed += 10;
        hold(Kind::Small, seed, 50, |script| {
            SessionScene::of(&mut session, script, ServedBy::Daemon, EngineName::CpuGrid)
        });
    });
    until("the forged scenes are freed", || session.daemon_status().unwrap().scenes == 0);
}

/// Frames with rules of an honest client beside a client that forges them.
#[test]
fn forged_rules_leave_the_frames_of_others_alone() {
    let (daemon, mut session) = served();
    let frames: Vec<FilteredFrame> = KINDS
        .into_iter()
        .enumerate()
        .map(|(seed, kind)| FilteredFrame::drawn(40 + 50 * seed, kind, seed as u64))
        .collect();
    honest_beside(&daemon, "rules", || {
        for given in &frames {
            let mask = given.submit(&mut session).wait().unwrap();
            assert!(mask.sorted() == given.pairs, "{} boxes", given.boxes.len());
        }
    });
}

/// A scene of an honest client, whose queries find what the model does, beside a client that forges queries.
#[test]
fn forged_queries_leave_the_scenes_of_others_alone() {
    let (daemon, mut session) = served();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    let mut source = Edits::new(5, 300);
    honest_beside(&daemon, "queries", || {
        let ops = source.next_edit();
        let grouped = Grouped::of(&ops);
        let edit = grouped.steps().into_iter().fold(scene.edit(), SceneEdit::step);
        drop(edit.commit(Report::Nothing).unwrap());
        let queries: Vec<_> = source.model().boxes().take(40).collect();
        let expected = source.model().query(&queries, QueryFilterData::None);
        assert_eq!(scene.query(&queries).unwrap().to_vec(), expected);
    });
}

/// Two honest writers of a shared scene, beside a client that forges requests about it.
#[test]
fn forged_members_leave_the_boxes_of_others_alone() {
    let daemon = TestDaemon::of_cores();
    let deadline = Duration::from_millis(20);
    let options = SceneOptions::default().with_most_boxes(2_000).with_tick_deadline(deadline);
    let mut sessions = [daemon.connect(), daemon.connect()];
    let [one, other] = &mut sessions;
    let mut first = one.scene(options.clone().with_shared(SHARED_SCENE)).unwrap();
    first.lease(0..10).unwrap();
    let mut second = other.scene(options.with_shared(SHARED_SCENE)).unwrap();
    second.lease(10..20).unwrap();
    // Far from all that the attacker may set.
    let at = |x: f32| Aabb::new([1e6 + x, 0.0, 0.0], [1e6 + x + 0.5, 1.0, 1.0]);
    let mut ticks = 0u32;
    honest_beside(&daemon, "shared", || {
        let x = (ticks % 7) as f32;
        let pending = first.edit().set(3, at(x)).set(4, at(9.0)).submit(Report::All).unwrap();
        drop(second.edit().set(13, at(x)).commit(Report::Changes).unwrap());
        let answer = pending.wait().unwrap();
        let own: Vec<Pair> = answer.pairs().iter().filter(|[_, b]| *b < 20).collect();
        let is_late = answer.late().iter().any(|range| range.start < 20);
        assert!(is_late || own == [[3, 13]], "{own:?}");
        ticks += 1;
    });
    assert!(ticks > 10, "{ticks} ticks");
    drop((first, second));
    until("the scenes have ended", || sessions[0].daemon_status().unwrap().scenes == 0);
}

/// Clients that ruin all of the memory that they share with the daemon, or cut it while that reads it: nobody else
/// notices, and the worker lives.
#[test]
fn ruined_memory_is_nobody_elses() {
    for mode in ["scribble", "truncate"] {
        let (counts, lived) = live_beside(mode);
        assert!(counts["rounds"] > 10, "{counts:?}");
        assert_eq!((lived.restarts, lived.here), (0, 0), "{mode}: {lived:?}");
    }
}

/// Memory that is none, or more than there may be, and memory of the daemon's that is cut by its descriptor.
#[test]
fn odd_memory_is_its_senders_alone() {
    let daemon = TestDaemon::of_cores();
    let (dir, worker, mut frames) = (daemon.dir(), daemon.worker(), InTurn::new(&[64, 1500]));
    let mut honest = daemon.connect();
    // Huge pages, of which a machine has none by default; a file; one without length; one with a hole of a pebibyte.
    let huge = memfd_create("huge", MemfdFlags::CLOEXEC | MemfdFlags::HUGETLB);
    let odd = [
        huge.ok().filter(|huge| ftruncate(huge, 1 << 21).is_ok()),
        std::fs::File::open("/proc/self/status").ok().map(Into::into),
        Memory::new(0).map(|memory| memory.file),
        memfd_create("holes", MemfdFlags::CLOEXEC).ok().filter(|f| ftruncate(f, 1 << 50).is_ok()),
    ];
    for (number, file) in odd.into_iter().enumerate() {
        let Some(file) = file else { continue };
        let let_in = raw::ask_in(&dir, &file).is_some_and(|(_, _, files)| !files.is_empty());
        assert!(!let_in, "memory {number}");
        assert_eq!(frames.check(&mut honest).unwrap(), ServedBy::Daemon);
    }
    // More segments than there may be.
    let greedy = RawClient::connect_at(&dir, 1).unwrap();
    let more = Memory::new(4).unwrap();
    let added = (0..100).take_while(|_| greedy.add_segment(&more.file)).count();
    assert!((5..30).contains(&added), "{added} segments");
    // The daemon's memory for answers, by a descriptor that is opened anew.
    for round in 0..8 {
        let vandal = RawClient::connect_at(&dir, 1).unwrap();
        let path = format!("/proc/self/fd/{}", vandal.their_file.as_raw_fd());
        std::fs::OpenOptions::new().write(true).open(path).unwrap().set_len(0).unwrap();
        let mut loan = vandal.loan_within(Duration::from_millis(1));
        if round % 2 == 0
            && let Some(mut loan) = loan.take()
        {
            loan.header = raw::cull(1, 2, EngineChoice::Auto);
            // The answer lies where nothing is any more.
            std::mem::forget(vandal.send(loan));
            std::thread::sleep(Duration::from_millis(5));
        }
        drop(vandal);
        assert_eq!(frames.check(&mut honest).unwrap(), ServedBy::Daemon);
    }
    // A request in a place that is held: it waits, and nobody looks for it all the time.
    let pushing = RawClient::connect_at(&dir, 1).unwrap();
    let mut loan = pushing.loan().unwrap();
    loan.header = raw::cull(1, 2, EngineChoice::Auto);
    let place = loan.place;
    let pending = pushing.send(loan);
    pending.answer(TIMEOUT).unwrap();
    write(pushing.board().0 + 8 * place, 2);
    pushing.wake();
    assert_eq!(frames.check(&mut honest).unwrap(), ServedBy::Daemon);
    assert_eq!(daemon.worker(), worker, "the worker lives");
}

/// Strangers at the door say nothing, or anything, and others are let in all the same.
#[test]
fn who_only_knocks_keeps_nobody_out() {
    let daemon = TestDaemon::of_cores();
    let mut frames = InTurn::new(&[64]);
    let mut silent = Vec::new();
    for round in 0..200_u32 {
        silent.extend(raw::knock(&daemon.dir(), &vec![round as u8; round as usize % 40]));
        if round % 20 == 0 {
            assert_eq!(frames.check(&mut daemon.connect()).unwrap(), ServedBy::Daemon);
        }
    }
    assert!(silent.len() > 100, "{} connected", silent.len());
}

/// Frames answered to an honest client beside an attacker, and to the attacker.
fn shares(mode: &'static str) -> (u64, u64) {
    let daemon = TestDaemon::of_cores();
    let long = Duration::from_secs(60) + 2 * attack_time();
    let mut session = daemon.session().deadline(long).connect().unwrap();
    let mut frames = InTurn::new(&[64]);
    let attacker = Attacker::start(daemon.path(), mode);
    // The attacker's requests wait when the count begins.
    std::thread::sleep(Duration::from_millis(300));
    let end = Instant::now() + attack_time();
    let (mut honest, mut waiting) = (0, VecDeque::new());
    // One frame waits while another is answered, so that a client that is itself late for a processor
    // has not missed its turn. They are given up with the attack: a starved client would wait for ever.
    while Instant::now() < end {
        let (boxes, expected) = &frames.frames[0];
        waiting.resize_with(2, || session.ask(boxes));
        let Some(mut pending) = waiting.pop_front() else { break };
        let left = end.saturating_duration_since(Instant::now());
        match pending.wait_timeout(left) {
            Ok(mask) => {
                assert!(mask.sorted() == *expected, "a wrong answer");
                honest += 1;
            }
            Err(Error::Timeout { .. }) => break,
            Err(error) => panic!("{error}"),
        }
    }
    let counts = attacker.end();
    frames.check(&mut session).unwrap();
    println!("{mode}: {honest} answers beside {counts:?}");
    (honest, counts["answered"])
}

/// With fair turns both would get the same number of answers; a client that is late for its turn,
/// because the machine is busy, gets fewer.
#[test]
fn a_token_for_each_request_and_many_connections_win_no_turns() {
    for mode in ["tokens", "ports"] {
        let (honest, hostile) = shares(mode);
        assert!(hostile > 0, "the attacker asked for nothing");
        assert!(4 * honest >= hostile, "{honest} answers beside {hostile}");
    }
}
