//! The examples, run as a user runs them: in process, and with a daemon.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use pairmaskd::spawn::{PrivateDaemon, PrivateSettings};

const MINIMAL_CLIENT: &str = env!("CARGO_BIN_EXE_minimal_client");
const FALLING_BOXES: &str = env!("CARGO_BIN_EXE_falling_boxes");

/// An example that runs longer than this counts as hanging.
const PATIENCE: Duration = Duration::from_secs(120);

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
    PrivateDaemon::start(&pairmaskd(), &PrivateSettings::default()).unwrap()
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
        if start.elapsed() > PATIENCE {
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

/// What `minimal_client` prints when `by` serves. The order of the pairs is the engine's.
fn check_minimal_client(text: &str, by: &str) {
    let mut lines: Vec<&str> = text.lines().collect();
    lines[1..].sort_unstable();
    let pairs = ["boxes 0 and 1 overlap", "boxes 0 and 2 overlap", "boxes 1 and 2 overlap"];
    assert_eq!(lines[0], format!("served by: {by}"));
    assert_eq!(lines[1..], pairs);
}

#[test]
fn minimal_client_in_process() {
    let empty = tempfile::tempdir().unwrap();
    let text = output(MINIMAL_CLIENT, &[], empty.path());
    check_minimal_client(&text, "InProcess");
}

#[test]
fn minimal_client_with_a_daemon() {
    let daemon = daemon();
    let text = output(MINIMAL_CLIENT, &[], daemon.dir().path());
    check_minimal_client(&text, "Daemon");
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
