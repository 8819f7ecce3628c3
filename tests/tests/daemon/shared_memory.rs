//! Shared memory of a daemon: what clients take of it, and that it is given back.

use pairmask_tests::prelude::*;

fn scene(n: u32, seed: u64) -> Vec<Aabb> {
    stress_scenes::named("uniform").boxes(n, seed)
}

/// A session of dense masks.
fn dense(daemon: &TestDaemon) -> Session {
    let dense = EncodingChoice::Only(Encoding::Dense);
    daemon.session().encoding(dense).connect().unwrap()
}

/// Boxes with dense masks of so many bytes: all in one place.
fn boxes_of_mask(bytes: f64) -> Vec<Aabb> {
    vec![Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); (16.0 * bytes).sqrt() as usize]
}

/// Memory of masks that is left to a daemon whose clients have large ones no more.
const LEFT_OF_MASKS: u64 = 512 << 10;

#[test]
fn memory_of_replies_is_given_back_when_clients_leave_and_the_others_notice_nothing() {
    let daemon = TestDaemon::of_cores();
    let stays = scene(1000, 7);
    let mut steady = daemon.session().answer_repeats(false).connect().unwrap();
    let expected = oracle::truth(&stays).pairs;
    steady.answer(&stays);
    let before = daemon.shared_bytes();
    let boxes = boxes_of_mask(4e6);
    for _ in 0..3 {
        let mut sessions: Vec<Session> = (0..4).map(|_| dense(&daemon)).collect();
        let masks: Vec<_> = sessions.iter_mut().map(|session| session.answer(&boxes)).collect();
        let all = BoxCount::new(boxes.len() as u32).pair_count();
        assert!(masks.iter().all(|mask| mask.count() == all));
        assert!(daemon.shared_bytes() > before + 15_000_000, "masks in the hands of clients");
        drop(masks);
        drop(sessions);
        until("the memory of masks comes back", || {
            assert_eq!(steady.answer(&stays).sorted(), expected);
            daemon.shared_bytes() < before + LEFT_OF_MASKS
        });
    }
}

#[test]
#[ignore = "takes minutes and 2 GB of /dev/shm: cargo test --release -p pairmask-tests --test daemon -- --ignored shared_memory"]
fn two_hundred_clients_of_60_000_boxes_leave_8_mb_of_shared_memory_at_most() {
    const AT_A_TIME: usize = 8;
    let daemon = TestDaemon::of_cores();
    drop(daemon.connect());
    let before = daemon.shared_bytes();
    let boxes = scene(60_000, 5);
    let mut most = 0;
    for _ in 0..200 / AT_A_TIME {
        let mut sessions: Vec<Session> = (0..AT_A_TIME).map(|_| dense(&daemon)).collect();
        let _masks: Vec<_> = sessions.iter_mut().map(|session| session.answer(&boxes)).collect();
        most = most.max(daemon.shared_bytes());
    }
    assert!(most > before + AT_A_TIME as u64 * 200_000_000);
    let left = || daemon.shared_bytes().saturating_sub(before);
    until("the memory of masks comes back", || left() < 8_000_000);
    println!("{most} bytes at most, {} left of {before}", left());
}

/// What a client has in its hands is nobody's to give back.
#[test]
fn a_mask_in_the_hands_of_a_client_stays_what_it_is_while_others_leave() {
    let daemon = TestDaemon::of_cores();
    let boxes = boxes_of_mask(1e6);
    let mut holder = dense(&daemon);
    let held = holder.answer(&boxes);
    let all = BoxCount::new(boxes.len() as u32).pair_count();
    let before = daemon.shared_bytes();
    for _ in 0..3 {
        let mut leaves = dense(&daemon);
        drop(leaves.answer(&boxes));
        drop(leaves);
        until("the memory of the other mask comes back", || {
            daemon.shared_bytes() < before + LEFT_OF_MASKS
        });
        assert_eq!(held.count(), all);
    }
}

/// A container's /dev/shm has 64 MB.
#[test]
fn clients_of_few_boxes_take_little_shared_memory() {
    let daemon = TestDaemon::of_cores();
    let before = daemon.shared_bytes();
    let boxes = scene(1000, 3);
    let mut sessions: Vec<Session> = (0..16).map(|_| daemon.connect()).collect();
    let expected = oracle::truth(&boxes).pairs;
    for session in &mut sessions {
        assert_eq!(session.answer(&boxes).sorted(), expected);
    }
    let each = (daemon.shared_bytes() - before) / 16;
    // 24 kB of boxes, an answer of some kB, and what the transport has for each.
    assert!(each < 256 << 10, "{each} bytes a client");
}
