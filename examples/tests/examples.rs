//! The examples, run as a user runs them: in process, and with a daemon.
#![allow(clippy::unwrap_used)]

#[path = "../falling_boxes/contacts.rs"]
mod contacts;
#[path = "../falling_boxes/simulation.rs"]
mod simulation;
#[path = "../falling_boxes/world.rs"]
mod world;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use pairmask::{Aabb, Backend, Report, ServedBy, Session};
use pairmaskd::serve::DaemonSettings;
use pairmaskd::spawn::PrivateDaemon;

use contacts::Pair;
use simulation::Simulation;
use world::World;

const MINIMAL_CLIENT: &str = env!("CARGO_BIN_EXE_minimal_client");
const FALLING_BOXES: &str = env!("CARGO_BIN_EXE_falling_boxes");

const SEVERAL_PROCESSES: &str = env!("CARGO_BIN_EXE_several_processes");

/// An example that runs longer than this counts as hanging.
const TIMEOUT: Duration = Duration::from_secs(120);

/// The daemon's binary: the path in `PAIRMASKD`, else the binary beside the examples.
fn pairmaskd() -> PathBuf {
    let beside = || Path::new(MINIMAL_CLIENT).with_file_name("pairmaskd");
    let binary = std::env::var_os("PAIRMASKD").map_or_else(beside, PathBuf::from);
    assert!(
        binary.exists(),
        "{} is missing: run `cargo build -p pairmaskd`, or all tests by `cargo test --workspace`",
        binary.display()
    );
    binary
}

fn daemon() -> PrivateDaemon {
    PrivateDaemon::start(&pairmaskd(), &DaemonSettings::default()).unwrap()
}

/// Starts an example with its instances in `dir`.
fn start(binary: &str, arguments: &[&str], dir: &Path) -> Child {
    Command::new(binary)
        .args(arguments)
        .env("PAIRMASK_RUNTIME_DIR", dir)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits for the end of an example, and kills one that hangs. Its few lines fit into the pipes.
fn finish(mut child: Child) -> Output {
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > TIMEOUT {
            child.kill().unwrap();
            panic!("the example hangs: {:?}", child.wait_with_output());
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.wait_with_output().unwrap()
}

/// What an example prints.
fn output(binary: &str, arguments: &[&str], dir: &Path) -> String {
    let output = finish(start(binary, arguments, dir));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{binary} {arguments:?}: {stderr}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn minimal_client_in_process_and_with_a_daemon() {
    let (empty, daemon) = (tempfile::tempdir().unwrap(), daemon());
    for (dir, by) in [(empty.path(), "InProcess"), (daemon.dir().path(), "Daemon")] {
        let text = output(MINIMAL_CLIENT, &[], dir);
        // The order of the pairs is the engine's.
        let mut lines: Vec<&str> = text.lines().collect();
        lines[1..].sort_unstable();
        let pairs = ["boxes 0 and 1 overlap", "boxes 0 and 2 overlap", "boxes 1 and 2 overlap"];
        assert_eq!(lines[0], format!("served by: {by}"));
        assert_eq!(lines[1..], pairs);
    }
}

#[test]
fn falling_boxes_pile_up_the_same_with_every_backend() {
    let daemon = daemon();
    let run = |backend: &str, dir: &Path| {
        let arguments = ["--boxes", "80", "--frames", "400", "--backend", backend];
        let text = output(FALLING_BOXES, &arguments, dir);
        let lines: Vec<String> = text.lines().map(str::to_owned).collect();
        assert_eq!(lines.len(), 4, "{text}");
        lines
    };
    let empty = tempfile::tempdir().unwrap();
    let here = run("in-process", empty.path());
    let there = run("daemon", daemon.dir().path());
    let auto = run("auto", daemon.dir().path());
    assert_eq!(here[0], "80 boxes, 400 frames, 0 of them by the daemon");
    assert_eq!(there[0], "80 boxes, 400 frames, 400 of them by the daemon");
    assert_eq!(auto[0], there[0]);
    // The lines of pairs and of the world's state. The line between depends on the machine's speed.
    for line in [1, 3] {
        assert_eq!(here[line], there[line]);
        assert_eq!(here[line], auto[line]);
    }
}

#[test]
fn falling_boxes_without_a_daemon_say_what_to_do() {
    let empty = tempfile::tempdir().unwrap();
    let output = finish(start(FALLING_BOXES, &["--backend", "daemon"], empty.path()));
    assert!(!output.status.success());
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("pairmaskd serve"), "{stderr}");
}

#[test]
fn falling_boxes_run_longer_than_the_daemon() {
    let daemon = daemon();
    let arguments = ["--boxes", "80", "--frames", "20000", "--backend", "auto"];
    let child = start(FALLING_BOXES, &arguments, daemon.dir().path());
    // The kill comes during the run or before its start: the example goes on in both cases.
    std::thread::sleep(Duration::from_millis(100));
    daemon.stop();
    let output = finish(child);
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("80 boxes, 20000 frames, "), "{text}");
}

#[test]
fn several_processes_write_one_scene() {
    let daemon = daemon();
    let arguments = ["--boxes", "500", "--ticks", "100"];
    let text = output(SEVERAL_PROCESSES, &arguments, daemon.dir().path());
    let last = text.lines().last().unwrap_or_default();
    assert!(last.contains("pairs began") && last.contains("of 100 ticks"), "{text}");
    let counted: u64 = last.split(' ').next().unwrap().parse().unwrap();
    assert!(counted > 0, "{text}");
    let empty = tempfile::tempdir().unwrap();
    let refused = finish(start(SEVERAL_PROCESSES, &[], empty.path()));
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && stderr.contains("pairmaskd serve"), "{stderr}");
    assert!(output(SEVERAL_PROCESSES, &["--help"], empty.path()).contains("--ticks"));
}

/// The pairs that a plain frame finds among the boxes of the scene, without those of static boxes.
fn fresh_pairs(session: &mut Session, simulation: &Simulation) -> Vec<Pair> {
    let scene = &simulation.scene;
    let boxes: Vec<Aabb> = (0..scene.len() as u32).map(|i| scene.get(i).unwrap()).collect();
    let mut frame = session.frame(boxes.len()).unwrap();
    frame.boxes_mut().copy_from_slice(&boxes);
    let mask = frame.submit().unwrap().wait().unwrap();
    let first_static = simulation.world.statics().start;
    let mut pairs: Vec<Pair> = mask.pairs().filter(|[a, _]| *a < first_static).collect();
    pairs.sort_unstable();
    pairs
}

/// Advances by one frame, and checks that the scene has every box that was not sent where the world
/// has it.
fn step(simulation: &mut Simulation) -> ServedBy {
    let before = simulation.world.boxes();
    let frame = simulation.step().unwrap();
    let (moved, _) = simulation.world.moved();
    assert_eq!(moved.len(), frame.sent);
    for (i, b) in (0..).zip(before) {
        if !moved.contains(&i) {
            assert_eq!(simulation.scene.get(i), Some(b), "box {i} moved and was not sent");
        }
    }
    frame.served_by
}

#[test]
fn contacts_of_falling_boxes_are_the_pairs_of_a_fresh_frame() {
    let daemon = daemon();
    let mut fresh = Session::builder().backend(Backend::InProcess).connect().unwrap();
    let mut with_daemon = daemon.session().backend(Backend::Auto).connect().unwrap();
    let mut here = Simulation::new(&mut fresh, World::new(80)).unwrap();
    let mut there = Simulation::new(&mut with_daemon, World::new(80)).unwrap();
    let mut daemon = Some(daemon);
    for frame in 0..600 {
        if frame == 200 {
            daemon.take().unwrap().stop();
        }
        if frame % 5 == 0 {
            // A resync in place of changes, to one of them.
            there.scene.resync();
        }
        let by = if daemon.is_some() { ServedBy::Daemon } else { ServedBy::InProcess };
        assert_eq!((step(&mut here), step(&mut there)), (ServedBy::InProcess, by), "{frame}");
        if frame % 20 != 0 {
            continue;
        }
        for simulation in [&mut here, &mut there] {
            let kept: Vec<Pair> = simulation.contacts.iter().map(|(pair, _)| pair).collect();
            assert_eq!(kept, fresh_pairs(&mut fresh, simulation), "{frame}");
            // Not taken: the next changes are still counted from the contacts.
            let all = simulation.scene.edit().commit(Report::All).unwrap();
            assert_eq!(kept, all.pairs().to_vec(), "{frame}");
        }
    }
    assert_eq!(here.world.boxes(), there.world.boxes());
    assert!((0.4..4.0).contains(&here.world.height()), "a heap of {} m", here.world.height());
    assert!(here.world.overlap() < 0.4, "boxes lie {} m inside each other", here.world.overlap());
    let (moved, _) = here.world.moved();
    assert!(moved.len() < 40, "{} of 80 boxes are awake", moved.len());
}
