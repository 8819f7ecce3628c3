//! Attacks, repeated for two seconds each or for `PAIRMASK_ATTACK_SECONDS`. Whatever an attacker
//! writes to memory that it has mapped, honest clients beside it get right answers, and the
//! instance serves again.
//!
//! Each test prints its counts (`--nocapture`). One file, because all of them start the same daemon, attacker and
//! honest clients, and each is a page.

use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask::{JoinOptions, SceneEdit};
use pairmask_core::mask::WordAddress;
use pairmask_tests::attack_time;
use pairmask_tests::attackers::lists::PAIRS;
use pairmask_tests::attackers::raw::{
    CHANNEL_ID, CLIENT_ID, REQUEST_ID, RawClient, answer, cull, read, word, write,
};
use pairmask_tests::attackers::shared::SHARED_SCENE;
use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::filtered_frames::{FilteredFrame, KINDS};
use pairmask_tests::frames::filtered;
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{Edits, Grouped, Kind, SessionScene, hold};
use pairmask_transport::{ProcessWatch, RuntimeDir, SegmentFiles};
use pairmask_wire::{InstanceName, ReplyError, items_in_mut};
use rayon::iter::ParallelIterator;
use rustix::process::{Pid, kill_process};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const ATTACKER: &str = env!("CARGO_BIN_EXE_attacker");
const FAULT_CLIENT: &str = env!("CARGO_BIN_EXE_fault_client");

fn scene(n: u32, seed: u64) -> Vec<Aabb> {
    stress_scenes::named("uniform").boxes(n, seed)
}

struct Attacker {
    process: Child,
    mode: &'static str,
}

impl Attacker {
    fn start(dir: &std::path::Path, mode: &'static str) -> Self {
        let process = Command::new(ATTACKER)
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

type Boxes = Vec<Aabb>;
type IndexPairs = Vec<[u32; 2]>;

struct InTurn {
    frames: Vec<(Boxes, IndexPairs)>,
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
}

#[derive(Debug, Default)]
struct Lived {
    there: u64,
    here: u64,
    restarts: u64,
}

/// Submits frames from a session that falls back, as long as the attacks last, and checks that
/// every answer is right. Waits until the daemon serves again after the attacks.
fn live_beside(mode: &'static str, max_clients: &str) -> (BTreeMap<String, u64>, Lived) {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none", "--max-clients", max_clients]);
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
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
    eventually("the daemon serves again", || {
        (frames.check(&mut session).unwrap() == ServedBy::Daemon).then_some(())
    });
    println!("{mode}: {lived:?}, attacker {counts:?}");
    (counts, lived)
}

#[test]
fn lengths_beyond_a_segment_are_refused_and_kill_no_process() {
    let (counts, lived) = live_beside("lengths", "16");
    assert!(counts["rounds"] > 10, "{counts:?}");
    assert_eq!(counts.get("outside"), None, "answered over memory of others: {counts:?}");
    assert_eq!((lived.restarts, lived.here), (0, 0), "{lived:?}");
}

/// Does what an honest client does, again and again, beside a client that forges requests in a mode.
fn honest_beside(daemon: &TestDaemon, mode: &'static str, mut honest: impl FnMut()) {
    let worker = daemon.worker();
    let attacker = Attacker::start(daemon.path(), mode);
    let end = Instant::now() + attack_time();
    while Instant::now() < end {
        honest();
    }
    let counts = attacker.end();
    println!("{mode}: {counts:?}");
    assert!(counts["answered"] > 10 && counts["refused"] > 10, "{counts:?}");
    assert_eq!(daemon.worker(), worker, "the worker lives");
}

/// Scenes of an honest client, held to the model, beside a client that forges edits.
#[test]
fn forged_edits_leave_the_scenes_of_others_alone() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let mut session = daemon.session().connect().unwrap();
    let mut seed = 0;
    honest_beside(&daemon, "edits", || {
        seed += 10;
        hold(Kind::Small, seed, 50, |script| {
            SessionScene::of(&mut session, script, ServedBy::Daemon, EngineName::CpuGrid)
        });
    });
    eventually("the forged scenes are freed", || {
        (session.daemon_status().unwrap().scenes == 0).then_some(())
    });
}

/// Frames with rules of an honest client beside a client that forges them.
#[test]
fn forged_rules_leave_the_frames_of_others_alone() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let mut session = daemon.session().connect().unwrap();
    let frames: Vec<FilteredFrame> = KINDS
        .into_iter()
        .enumerate()
        .map(|(seed, kind)| FilteredFrame::drawn(40 + 50 * seed, kind, seed as u64))
        .collect();
    honest_beside(&daemon, "rules", || {
        for given in &frames {
            let mut frame = session.frame(given.boxes.len()).unwrap();
            frame.write(&given.boxes).unwrap();
            let options = filtered(&Arc::new(given.rules.clone()));
            let mask = frame.submit_with(&options).unwrap().wait().unwrap();
            assert!(mask.sorted() == given.pairs, "{} boxes", given.boxes.len());
        }
    });
}

/// A scene of an honest client, whose queries find what the model does, beside a client that forges queries.
#[test]
fn forged_queries_leave_the_scenes_of_others_alone() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let mut session = daemon.session().connect().unwrap();
    let mut scene = session.scene(SceneOptions::default());
    let mut source = Edits::new(5, 300);
    honest_beside(&daemon, "queries", || {
        let ops = source.next_edit();
        let grouped = Grouped::of(&ops);
        let edit = grouped.steps().into_iter().fold(scene.edit(), SceneEdit::step);
        drop(edit.commit(Report::Nothing).unwrap());
        let queries: Vec<_> = source.model().boxes().take(40).collect();
        let expected = source.model().query(&queries, QueryTags::None);
        assert_eq!(scene.query(&queries).find().unwrap().to_vec(), expected);
    });
}

/// Two honest writers of a shared scene, beside a client that forges requests about it.
#[test]
fn forged_members_leave_the_boxes_of_others_alone() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let deadline = Duration::from_millis(20);
    let options = JoinOptions::default().with_most_boxes(2_000).with_tick_deadline(deadline);
    let mut sessions = [daemon.session().connect().unwrap(), daemon.session().connect().unwrap()];
    let [one, other] = &mut sessions;
    let mut first = one.join_scene(SHARED_SCENE, options).unwrap();
    first.lease(0..10).unwrap();
    let mut second = other.join_scene(SHARED_SCENE, options).unwrap();
    second.lease(10..20).unwrap();
    let worker = daemon.worker();
    let (mut ticks, mut counts) = (0u32, BTreeMap::new());
    // Far from whatever the attacker may set.
    let at = |x: f32| Aabb::new([1e6 + x, 0.0, 0.0], [1e6 + x + 0.5, 1.0, 1.0]);
    let begin = Instant::now();
    // How much an attacker comes to do goes by the machine: as many attackers as it takes, one after the other.
    let is_enough = |ticks: u32, counts: &BTreeMap<String, u64>| {
        let more_than = |name: &str| counts.get(name).is_some_and(|count| *count > 10);
        ticks > 10 && more_than("answered") && more_than("refused")
    };
    let mut attacker = Attacker::start(daemon.path(), "shared");
    let mut end = begin + attack_time();
    loop {
        if Instant::now() >= end {
            for (name, count) in attacker.end() {
                *counts.entry(name).or_insert(0) += count;
            }
            if is_enough(ticks, &counts) {
                break;
            }
            assert!(begin.elapsed() < PATIENCE, "{ticks} ticks, {counts:?}");
            attacker = Attacker::start(daemon.path(), "shared");
            end = Instant::now() + attack_time();
        }
        let x = (ticks % 7) as f32;
        let pending = first.edit().set(3, at(x)).set(4, at(9.0)).submit(Report::All).unwrap();
        drop(second.edit().set(13, at(x)).commit(Report::Changes).unwrap());
        let answer = pending.wait().unwrap();
        let own: Vec<[u32; 2]> = answer.pairs().iter().filter(|[_, b]| *b < 20).collect();
        let is_late = answer.late().iter().any(|range| range.start < 20);
        assert!(is_late || own == [[3, 13]], "{own:?}");
        ticks += 1;
    }
    println!("shared: {ticks} ticks, {counts:?}");
    assert_eq!(daemon.worker(), worker, "the worker lives");
    drop((first, second));
    eventually("the scenes have ended", || {
        (sessions[0].daemon_status().unwrap().scenes == 0).then_some(())
    });
}

#[test]
fn a_request_under_another_clients_id_is_not_answered() {
    let (counts, lived) = live_beside("identities", "16");
    assert!(counts["rounds"] > 0 && lived.there > 10, "{lived:?}, {counts:?}");
    // The transport never frees a request of a client that does not exist, and panics after 128
    // ports were closed with such a request.
    assert!(128 * lived.restarts <= counts["rounds"], "{lived:?}, {counts:?}");
}

/// The attacker's copy of the victim's request, with empty boxes, arrives before the victim's.
#[test]
fn a_request_in_the_name_of_another_is_not_answered() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let connect = |token| {
        let client = eventually("a connection", || RawClient::connect_at(&daemon.dir(), token, 2));
        let mut loan = client.loan(1).unwrap();
        *loan.user_header_mut() = cull(token, 0, 0, EngineChoice::Auto);
        let pending = client.send(loan).unwrap();
        answer(&pending, PATIENCE).unwrap();
        client
    };
    let (attacker, victim) = (connect(1001), connect(77));
    daemon.signal_worker(Signal::STOP);
    let asked = cull(77, 5, 10, EngineChoice::Auto);
    let send = |client: &RawClient, same: Aabb, words: &[(usize, u64)]| {
        let mut loan = client.loan(2).unwrap();
        items_in_mut(loan.payload_mut(), BoxCount::new(10)).unwrap().fill(same);
        *loan.user_header_mut() = asked;
        for (index, value) in words {
            write(word(loan.header(), *index), *value);
        }
        client.send(loan).unwrap()
    };
    let honest = send(&victim, Aabb::new([0.0; 3], [1.0; 3]), &[]);
    let words = [CLIENT_ID, CLIENT_ID + 1, CHANNEL_ID, REQUEST_ID]
        .map(|index| (index, read(word(honest.header(), index))));
    let forged = send(&attacker, Aabb::EMPTY, &words);
    daemon.signal_worker(Signal::CONT);
    let header = answer(&honest, PATIENCE).unwrap();
    assert_eq!((header.frame, header.pair_count), (5, 45));
    assert!(answer(&forged, Duration::from_millis(50)).is_none());
}

#[test]
fn nonexistent_channels_kill_a_worker_at_most() {
    let (counts, _) = live_beside("channels", "16");
    assert!(counts["rounds"] > 0, "{counts:?}");
}

#[test]
fn memory_cut_while_it_is_read_kills_a_worker_at_most() {
    let (counts, _) = live_beside("truncate", "16");
    assert!(counts["rounds"] > 0, "{counts:?}");
}

/// Random words in the queues may kill a worker, but not make it hang. A worker that goes where they lead
/// may write into another client's queues before it dies, and that client dies of them. So honest
/// clients are processes here, one after the other. No answer is wrong.
#[test]
fn scribbled_queues_kill_processes_at_most() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let start = || {
        eventually("an honest client begins", || {
            let honest = FaultClient::try_start(FAULT_CLIENT, &daemon, &["right", "auto"]);
            honest.and_then(|mut honest| honest.is_ready().then_some(honest))
        })
    };
    let (mut honest, mut said, mut died) = (start(), Vec::new(), 0);
    let attacker = Attacker::start(daemon.path(), "scribble");
    let end = Instant::now() + attack_time();
    while Instant::now() < end {
        std::thread::sleep(Duration::from_millis(10));
        if honest.has_ended() {
            said.extend(std::mem::replace(&mut honest, start()).end());
            died += 1;
        }
    }
    let counts = attacker.end();
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
    let mut frames = InTurn::new(&[64]);
    eventually("the daemon serves again", || {
        (frames.check(&mut session).unwrap() == ServedBy::Daemon).then_some(())
    });
    if honest.has_ended() {
        honest = start();
    }
    said.extend(honest.end());
    println!("honest: {said:?}, {died} died; attacker {counts:?}");
    assert!(counts["rounds"] > 0, "{counts:?}");
    let answers = said.iter().map(|line| line.strip_suffix(" answers")?.parse::<u64>().ok());
    // Who died has not said how many it had: they were right. The last one lives.
    let answers: Option<Vec<u64>> = answers.collect();
    assert!(answers.is_some_and(|answers| answers.iter().sum::<u64>() > 0), "{said:?}");
}

/// Frames answered to an honest client beside an attacker, and to the attacker.
fn shares(mode: &'static str) -> (u64, u64) {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
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
fn assert_fair(mode: &'static str) {
    let (honest, hostile) = shares(mode);
    assert!(hostile > 0, "the attacker asked for nothing");
    assert!(4 * honest >= hostile, "{honest} answers beside {hostile}");
}

#[test]
fn a_token_for_each_request_wins_no_turns() {
    assert_fair("tokens");
}

#[test]
fn many_ports_win_no_turns() {
    assert_fair("ports");
}

fn hostile_daemon(
    mode: &'static str,
    encoding: EncodingChoice,
) -> (tempfile::TempDir, Attacker, Session) {
    let dir = tempfile::tempdir().unwrap();
    let attacker = Attacker::start(dir.path(), mode);
    let builder = Session::builder().runtime_dir(RuntimeDir::at(dir.path()));
    let builder = builder.backend(Backend::Daemon).encoding(encoding);
    let builder = builder.deadline(Duration::from_secs(5));
    let session = eventually("the hostile daemon serves", || builder.clone().connect().ok());
    (dir, attacker, session)
}

#[test]
fn an_answer_longer_than_its_memory_is_refused() {
    let (dir, attacker, mut session) = hostile_daemon("daemon", EncodingChoice::Auto);
    let end = Instant::now() + attack_time();
    let mut refused = 0;
    let mut accepted = 0;
    let mut sizes = [5_000, 50_000, 300_000].into_iter().cycle();
    while Instant::now() < end {
        let mut frame = session.frame(sizes.next().unwrap()).unwrap();
        frame.boxes_mut().fill(Aabb::EMPTY);
        match frame.submit().unwrap().wait() {
            // The whole of its segment has not so many bytes as the least of these masks.
            Ok(mask) => accepted += u64::from(mask.reply_words().len() > 1),
            Err(Error::Reply(ReplyError::Malformed { .. })) => refused += 1,
            Err(error) => println!("daemon: {error}"),
        }
    }
    let counts = attacker.end();
    println!("daemon: {refused} refused, {accepted} accepted, attacker {counts:?}");
    assert!(refused > 10 && accepted == 0, "{refused} refused, {accepted} accepted");
    clean_up(dir.path());
}

#[test]
fn a_list_that_changes_while_it_is_read_names_no_box_that_is_not_there() {
    let list = EncodingChoice::Only(Encoding::List);
    let (dir, attacker, mut session) = hostile_daemon("lists", list);
    let n = PAIRS as u32 + 1;
    let is_pair = |[a, b]: [u32; 2]| a < b && b < n;
    let end = Instant::now() + attack_time();
    let (mut looks, mut dropped, mut broken) = (0, 0, 0);
    // On a busy machine the attacker may get no core for a while.
    let is_seen = |dropped: u64, broken: u64| dropped > 10 && broken > 10;
    let goes_on = |dropped, broken| {
        let now = Instant::now();
        now < end || !is_seen(dropped, broken) && now < end + PATIENCE
    };
    while goes_on(dropped, broken) {
        let mut frame = session.frame(n as usize).unwrap();
        frame.boxes_mut().fill(Aabb::EMPTY);
        let mask = frame.submit().unwrap().wait().unwrap();
        for _ in 0..100 {
            let mut seen = 0;
            mask.for_each(|a, b| {
                assert!(is_pair([a, b]), "({a}, {b})");
                seen += 1;
            });
            mask.for_each_slice(|pairs| assert!(pairs.iter().all(|&[a, b]| is_pair([a, b]))));
            assert!(mask.pairs().all(is_pair) && mask.par_pairs().all(is_pair));
            assert!(mask.to_vec().into_iter().all(is_pair));
            for word in mask.words() {
                let WordAddress::Sparse { row, block } = word.address else { panic!("{word:?}") };
                assert_eq!(word.bits.count(), 1);
                assert!(is_pair([row, 32 * block + word.bits.0.trailing_zeros()]), "{word:?}");
            }
            let view = mask.view();
            assert!(view.count() <= PAIRS && !view.contains(n, 0) && !view.contains(3, 3));
            looks += 1;
            dropped += u64::from(seen < PAIRS);
            broken += u64::from(view.verify().is_err());
        }
    }
    let counts = attacker.end();
    println!("lists: {looks} looks, {dropped} with less, {broken} broken, attacker {counts:?}");
    assert!(is_seen(dropped, broken) && dropped < looks, "{dropped}, {broken} of {looks}");
    clean_up(dir.path());
}

/// A port's memory is found, but neither memory beside it nor another port's.
#[test]
fn a_segment_reaches_as_far_as_its_file() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let connect = |token| RawClient::connect_at(&daemon.dir(), token, 80).unwrap();
    let (one, other) = (connect(1), connect(2));
    let mut loan = one.loan(80).unwrap();
    let pages = loan.payload_mut();
    let (start, bytes) = (pages.as_ptr() as usize, size_of_val(pages));
    let files = SegmentFiles::new(&daemon.dir(), &InstanceName::default());
    assert!(files.find(other.ports.port.id().value(), start).is_none(), "another's memory");
    assert!(files.find(one.ports.port.id().value(), loan_on_heap()).is_none(), "no segment");
    let segment = files.find(one.ports.port.id().value(), start).unwrap();
    assert!(segment.holds(start, bytes) && segment.holds(start, 8));
    assert!(!segment.holds(start, 1 << 30) && !segment.holds(start, usize::MAX));
    assert!(!segment.holds(start - (1 << 30), 8) && !segment.holds(start + (1 << 30), 8));
    let ending = format!("_{}.data", one.ports.port.id().value());
    let mut files = daemon.shared_files().into_iter();
    let path = files.find(|path| path.to_str().unwrap().ends_with(&ending)).unwrap();
    std::fs::OpenOptions::new().write(true).open(path).unwrap().set_len(8192).unwrap();
    assert!(!segment.holds(start, bytes), "cut short");
    // The rest of the memory must not be touched, not even to drop it.
    std::mem::forget(loan);
}

fn loan_on_heap() -> usize {
    std::ptr::from_ref(&*Box::new(0u64)) as usize
}

fn pid(raw: u32) -> Pid {
    Pid::from_raw(i32::try_from(raw).unwrap()).unwrap()
}

/// The worker that a supervisor has started, as soon as there is one.
fn child_of(supervisor: u32) -> Option<u32> {
    let path = format!("/proc/{supervisor}/task/{supervisor}/children");
    std::fs::read_to_string(path).ok()?.split_whitespace().next()?.parse().ok()
}

fn serve(dir: &std::path::Path) -> Child {
    Command::new(DAEMON)
        .args(["serve", "--gpu", "none"])
        .env("PAIRMASK_RUNTIME_DIR", dir)
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Starts a daemon where another was killed, and stops it when it has answered.
fn check_that_it_serves(dir: &std::path::Path, frames: &mut InTurn) {
    let mut supervisor = serve(dir);
    let place = RuntimeDir::at(dir);
    let started = Instant::now();
    let mut session = loop {
        // The record may still be that of the daemon before, whose worker is just ending.
        let record = place.read_record(&InstanceName::default());
        let session = Session::builder().runtime_dir(place.clone()).backend(Backend::Daemon);
        if record.is_some_and(|record| record.supervisor_pid == supervisor.id())
            && let Ok(session) = session.connect()
        {
            break session;
        }
        if let Some(status) = supervisor.try_wait().unwrap() {
            panic!("the next daemon ended ({status}): {}", said(supervisor.stderr.take()));
        }
        if started.elapsed() > PATIENCE {
            supervisor.kill().unwrap();
            panic!("the next daemon does not serve: {}", said(supervisor.stderr.take()));
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    assert_eq!(frames.check(&mut session).unwrap(), ServedBy::Daemon);
    drop(session);
    kill_process(pid(supervisor.id()), Signal::TERM).unwrap();
    supervisor.wait().unwrap();
}

fn clean_up(dir: &std::path::Path) {
    let (place, name) = (RuntimeDir::at(dir), InstanceName::default());
    for file in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if file.file_name().to_string_lossy().starts_with(&place.shm_prefix(&name)) {
            let _ = std::fs::remove_file(file.path());
        }
    }
    let _ = std::fs::remove_dir_all(place.transport_root(&name));
}

/// Starts daemons that something is done to, in which they are killed, and checks that the next one serves.
fn kill_starting(what: &str, mut kill: impl FnMut(&mut Child, u64)) {
    let dir = tempfile::tempdir().unwrap();
    let mut frames = InTurn::new(&[64]);
    let end = Instant::now() + attack_time();
    let mut rounds = 0;
    while rounds == 0 || Instant::now() < end {
        kill(&mut serve(dir.path()), rounds);
        check_that_it_serves(dir.path(), &mut frames);
        rounds += 1;
    }
    println!("{what}: {rounds} rounds");
    clean_up(dir.path());
}

/// The worker is stopped before it is bound to its supervisor, which ends meanwhile.
#[test]
fn a_worker_that_was_orphaned_before_it_was_bound_ends() {
    kill_starting("orphans", |supervisor, _| {
        // Without a pause: it is bound soon after.
        let worker = (0..10_000_000).find_map(|_| child_of(supervisor.id())).unwrap();
        let watch = ProcessWatch::open(worker);
        let _ = kill_process(pid(worker), Signal::STOP);
        supervisor.kill().unwrap();
        supervisor.wait().unwrap();
        let _ = kill_process(pid(worker), Signal::CONT);
        eventually("the orphan ends", || {
            watch.as_ref().is_none_or(|watch| !watch.is_alive()).then_some(())
        });
    });
}

/// The kill comes at varying times between the first instruction and a serving worker.
#[test]
fn a_daemon_killed_while_it_starts_does_not_keep_the_next_from_serving() {
    kill_starting("killed at the start", |supervisor, round| {
        std::thread::sleep(Duration::from_micros(round * 7919 % 30_000));
        supervisor.kill().unwrap();
        supervisor.wait().unwrap();
    });
}

/// A worker without a supervisor holds the server port, but not the lock.
#[test]
fn a_process_that_blocks_an_instance_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let mut blocking = Command::new(DAEMON)
        .args(["serve", "--gpu", "none", "--worker", &std::process::id().to_string()])
        .env("PAIRMASK_RUNTIME_DIR", dir.path())
        .spawn()
        .unwrap();
    let place = RuntimeDir::at(dir.path());
    eventually("the worker serves", || place.read_record(&InstanceName::default()));
    let mut refused = serve(dir.path());
    let text = said(refused.stderr.take());
    assert!(!refused.wait().unwrap().success());
    let process = format!("process {} (pairmaskd", blocking.id());
    assert!(text.contains(&process) && text.contains("kill -9"), "{text}");
    blocking.kill().unwrap();
    blocking.wait().unwrap();
    check_that_it_serves(dir.path(), &mut InTurn::new(&[64]));
    clean_up(dir.path());
}

fn said(stderr: Option<ChildStderr>) -> String {
    let mut text = String::new();
    stderr.unwrap().read_to_string(&mut text).unwrap();
    text
}
