//! Clients in C and C++: the suite's scenes and the golden ones, every call and every error, with sanitizers and
//! by valgrind, in process and through a daemon that may be killed.

use std::time::Instant;

// The libraries of this crate are what the programs are linked with.
use pairmask_c as _;
use pairmask_core::Encoding;
use pairmask_tests::c_program::{Culling, Program, Watch};
use pairmask_tests::daemon::{PATIENCE, TestDaemon};
use pairmask_tests::golden::{self, GOLDEN};
use pairmask_tests::oracle::{self, pair_set_hash};
use pairmask_tests::stress_scenes;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const C: &[&str] = &["-std=c11"];
const CPP: &[&str] = &["-std=c++17"];
const BY_DAEMON: u32 = 1;
const IN_PROCESS: u32 = 2;

/// Sizes of the suite that a program answers under a watch within seconds.
const SIZES: [u32; 10] = [0, 1, 2, 3, 31, 32, 33, 64, 70, 345];

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

/// Asserts that a program finds the oracle's pairs.
fn check_suite(program: &mut Culling, sizes: &[u32], served_by: u32) {
    for scene in stress_scenes::ALL {
        for &n in sizes {
            let boxes = scene.boxes(n, 1);
            let truth = oracle::truth(&boxes);
            let found = program.frame(&boxes);
            assert_eq!(found.pairs, truth.pairs, "{}, {n} boxes", scene.name());
            let census = (truth.census.empty, truth.census.invalid);
            assert_eq!((found.empty, found.invalid), census, "{}, {n} boxes", scene.name());
            assert_eq!(found.served_by, served_by);
        }
    }
}

/// Asserts that a program finds the golden pair sets.
fn check_golden(program: &mut Culling) {
    let found = GOLDEN.map(|(name, _)| {
        let pairs = program.frame(golden::scene(name).boxes()).pairs;
        (name, pair_set_hash(&pairs))
    });
    assert_eq!(found, GOLDEN);
}

fn conforms(source: &str, flags: &[&str]) {
    let folder = folder();
    let program = Program::build(source, flags, Watch::Sanitizers, folder.path());
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let dir = daemon.path().to_str().expect("a path in UTF-8");
    for (backend, served_by) in [("in-process", IN_PROCESS), ("daemon", BY_DAEMON)] {
        for encoding in Encoding::ALL.map(Encoding::as_str).into_iter().chain(["auto"]) {
            let mut culling = program.cull(&[backend, dir, encoding]);
            check_suite(&mut culling, &SIZES, served_by);
            check_golden(&mut culling);
            culling.end();
        }
    }
}

#[test]
fn a_program_in_c_finds_the_pairs_of_the_suite() {
    conforms("conformance.c", C);
}

#[test]
fn a_program_in_cpp_finds_the_pairs_of_the_suite() {
    conforms("conformance.cpp", CPP);
}

#[test]
#[ignore = "slow: the nightly tier runs it"]
fn valgrind_finds_nothing_in_frames() {
    let folder = folder();
    for (source, flags) in [("conformance.c", C), ("conformance.cpp", CPP)] {
        let program = Program::build(source, flags, Watch::Valgrind, folder.path());
        let mut culling = program.cull(&["in-process", "/", "auto"]);
        check_suite(&mut culling, &[0, 3, 33, 345], IN_PROCESS);
        culling.end();
    }
}

fn every_call_and_every_error(watch: Watch, backends: &[&str]) {
    let folder = folder();
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let dir = daemon.path().to_str().expect("a path in UTF-8");
    let standards: [(&str, &[&str]); 4] = [
        ("calls.c", C),
        ("calls.cpp", CPP),
        ("calls.cpp", &["-std=c++17", "-fno-exceptions"]),
        ("calls.cpp", &["-std=c++20"]),
    ];
    for (source, flags) in standards {
        let program = Program::build(source, flags, watch, folder.path());
        for backend in backends {
            for encoding in ["auto", "sparse"] {
                assert_eq!(program.run(&[backend, dir, encoding]), "all calls\n");
            }
        }
    }
}

#[test]
fn sanitizers_find_nothing_in_every_call_and_every_error() {
    every_call_and_every_error(Watch::Sanitizers, &["in-process", "daemon"]);
}

#[test]
#[ignore = "slow: the nightly tier runs it"]
fn valgrind_finds_nothing_in_every_call_and_every_error() {
    // valgrind up to 3.19 does not know pidfd_open, by which a client watches its daemon.
    every_call_and_every_error(Watch::Valgrind, &["in-process"]);
}

#[test]
fn a_daemon_that_is_killed_costs_no_frame() {
    let folder = folder();
    let program = Program::build("conformance.c", C, Watch::Sanitizers, folder.path());
    let mut daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let dir = daemon.path().to_str().expect("a path in UTF-8").to_owned();
    let mut culling = program.cull(&["auto", &dir, "auto"]);
    let mut frames = 0;
    // Culls frames, one or as many as it takes until they are answered by who should.
    let mut frame = |served_by: Option<u32>| {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let scene = stress_scenes::ALL[frames % stress_scenes::ALL.len()];
            let boxes = scene.boxes(200, frames as u64);
            frames += 1;
            let found = culling.frame(&boxes);
            assert_eq!(found.pairs, oracle::truth(&boxes).pairs, "frame {frames}");
            match served_by {
                Some(wanted) if wanted != found.served_by => assert!(Instant::now() < deadline),
                _ => return,
            }
        }
    };
    for _ in 0..3 {
        (0..20).for_each(|_| frame(None));
        frame(Some(BY_DAEMON));
        daemon.kill();
        (0..20).for_each(|_| frame(None));
        frame(Some(IN_PROCESS));
        daemon.restart();
        frame(Some(BY_DAEMON));
    }
    culling.end();
}

/// The watch and the comparison can fail.
#[test]
#[should_panic(expected = "assertion")]
fn a_lost_pair_is_seen() {
    let folder = folder();
    let program = Program::build("conformance.c", C, Watch::Sanitizers, folder.path());
    let mut culling = program.cull(&["in-process", "/", "auto"]);
    let boxes = stress_scenes::named("uniform").boxes(300, 2);
    let mut truth = oracle::truth(&boxes).pairs;
    assert!(truth.pop().is_some());
    assert_eq!(culling.frame(&boxes).pairs, truth, "assertion");
}
