//! Daemons that attack their clients, and daemons that are attacked while they start.

use std::time::{Duration, Instant};

use pairmask_core::mask::WordAddress;
use pairmask_tests::attack_time;
use pairmask_tests::attackers::lists::PAIRS;
use pairmask_tests::daemon::pairmaskd;
use pairmask_tests::prelude::*;
use pairmask_transport::ProcessWatch;
use pairmask_wire::ReplyError;
use rayon::iter::ParallelIterator;
use rustix::process::{Pid, kill_process};

use super::{Attacker, InTurn};

/// The place of an attacker that serves, itself, and a session of it.
fn hostile_daemon(mode: &'static str, encoding: EncodingChoice) -> (TestDaemon, Attacker, Session) {
    let slot = TestDaemon::idle(pairmaskd(), &[]);
    let attacker = Attacker::start(slot.path(), mode);
    let builder = slot.session().encoding(encoding).deadline(Duration::from_secs(5));
    let session = eventually("the hostile daemon serves", || builder.clone().connect().ok());
    (slot, attacker, session)
}

#[test]
fn an_answer_longer_than_its_memory_is_refused() {
    let (_slot, attacker, mut session) = hostile_daemon("daemon", EncodingChoice::Auto);
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
}

#[test]
fn a_list_that_changes_while_it_is_read_names_no_box_that_is_not_there() {
    let list = EncodingChoice::Only(Encoding::List);
    let (_slot, attacker, mut session) = hostile_daemon("lists", list);
    let n = PAIRS as u32 + 1;
    let is_pair = |[a, b]: [u32; 2]| a < b && b < n;
    let end = Instant::now() + attack_time();
    let (mut looks, mut dropped, mut broken) = (0, 0, 0);
    // On a busy machine the attacker may get no core for a while.
    let is_seen = |dropped: u64, broken: u64| dropped > 10 && broken > 10;
    let goes_on = |dropped, broken| {
        let now = Instant::now();
        now < end || !is_seen(dropped, broken) && now < end + TIMEOUT
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
}

/// The worker that a supervisor has started, as soon as there is one.
fn child_of(supervisor: u32) -> Option<u32> {
    let path = format!("/proc/{supervisor}/task/{supervisor}/children");
    std::fs::read_to_string(path).ok()?.split_whitespace().next()?.parse().ok()
}

/// Starts a daemon where another was killed, and stops it when it has answered.
fn check_that_it_serves(daemon: &mut TestDaemon, frames: &mut InTurn) {
    daemon.restart();
    assert_eq!(frames.check(&mut daemon.connect()).unwrap(), ServedBy::Daemon);
    daemon.stop();
}

/// Starts daemons that are killed meanwhile, by their supervisors' ids, and checks that the next one serves.
fn kill_starting(what: &str, mut kill: impl FnMut(&mut TestDaemon, u32, u64)) {
    let mut daemon = TestDaemon::idle(pairmaskd(), &["--gpu", "none"]);
    let mut frames = InTurn::new(&[64]);
    let end = Instant::now() + attack_time();
    let mut rounds = 0;
    while rounds == 0 || Instant::now() < end {
        let supervisor = daemon.spawn();
        kill(&mut daemon, supervisor, rounds);
        check_that_it_serves(&mut daemon, &mut frames);
        rounds += 1;
    }
    println!("{what}: {rounds} rounds");
}

/// The worker is stopped before it is bound to its supervisor, which ends meanwhile.
#[test]
fn a_worker_that_was_orphaned_before_it_was_bound_ends() {
    kill_starting("orphans", |daemon, supervisor, _| {
        // Without a pause: it is bound soon after.
        let worker = (0..10_000_000).find_map(|_| child_of(supervisor)).unwrap();
        let watch = ProcessWatch::open(worker);
        let pid = Pid::from_raw(worker.cast_signed()).unwrap();
        let _ = kill_process(pid, Signal::STOP);
        daemon.kill();
        let _ = kill_process(pid, Signal::CONT);
        until("the orphan ends", || watch.as_ref().is_none_or(|watch| !watch.is_alive()));
    });
}

/// The kill comes at varying times between the first instruction and a serving worker.
#[test]
fn a_daemon_killed_while_it_starts_does_not_keep_the_next_from_serving() {
    kill_starting("killed at the start", |daemon, _, round| {
        std::thread::sleep(Duration::from_micros(round * 7919 % 30_000));
        daemon.kill();
    });
}
