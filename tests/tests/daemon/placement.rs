//! Lanes keep off the core to which a client has bound a thread.

use pairmask_core::Aabb;
use pairmask_tests::daemon::{TestDaemon, eventually};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

#[test]
fn lanes_leave_the_core_of_a_bound_client_and_come_back() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let all = sched_getaffinity(None).unwrap();
    let first = (0..CpuSet::MAX_CPU).find(|core| all.is_set(*core)).unwrap();
    let without = |core: usize| {
        let mut cores = all;
        cores.unset(core);
        // A machine with one core has no other for its lanes.
        if cores.count() == 0 { all } else { cores }
    };
    let mut session = daemon.session().connect().unwrap();
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 2];
    let mut frame = || {
        let mut frame = session.frame(boxes.len()).unwrap();
        frame.boxes_mut().copy_from_slice(&boxes);
        assert_eq!(frame.submit().unwrap().wait().unwrap().to_vec(), [(0, 1)]);
    };
    let mut run_on = |expected: CpuSet, what: &str| {
        eventually(what, || {
            frame();
            // The first lane is the worker's first thread. Others rest, and are placed when they are wanted.
            (sched_getaffinity(Some(daemon.worker())).unwrap() == expected).then_some(())
        });
    };
    run_on(all, "lanes run anywhere");
    let mut one = CpuSet::new();
    one.set(first);
    sched_setaffinity(None, &one).unwrap();
    run_on(without(first), "lanes leave the core");
    sched_setaffinity(None, &all).unwrap();
    run_on(all, "lanes come back");
}
