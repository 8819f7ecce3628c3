//! `top` without a terminal: a table or JSON, of a daemon that serves, was killed, or never was; on one that goes.

use std::io::Read;
use std::process::Stdio;

use pairmask::{Report, SceneOptions};
use pairmask_core::Aabb;
use rustix::process::Signal;

use crate::support::{Sandbox, Serving, eventually, keys, names, pty};

/// Asks for frames and edits, some of them while `top` waits between its two looks.
fn with_load(serving: &Serving, work: impl FnOnce()) {
    let mut session = serving.session();
    let boxes = [0.0_f32, 0.5, 1.0].map(|x| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]));
    let frame = |session: &mut pairmask::Session| {
        let mut frame = session.frame(3).unwrap();
        frame.write(&boxes).unwrap();
        frame.submit().unwrap().wait().unwrap();
    };
    frame(&mut session);
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    for at in 0..4_u32 {
        let x = at as f32;
        let edit = scene.edit().set(at, Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]));
        drop(edit.commit(Report::Changes).unwrap());
    }
    work();
    frame(&mut session);
}

#[test]
fn clients_and_scenes_are_shown_as_a_table_and_as_json() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "--gpu none", "default");
    with_load(&serving, || {
        let report = sandbox.run_line("top --json --interval 20").json();
        let fields = "instance state pid interval_ns totals clients shared_scenes";
        assert_eq!(keys(&report), names(fields));
        assert_eq!((&report["instance"], &report["state"]), (&"default".into(), &"alive".into()));
        assert!(report["interval_ns"].as_u64().unwrap() >= 20_000_000, "{report}");
        let client = &report["clients"][0];
        let fields = "session process user name client connected_ns boxes moved_share pairs engine \
                      threads frames edits queries errors frames_per_second stages cpu_share \
                      received_bytes_per_second sent_bytes_per_second memory_bytes scenes";
        assert_eq!(keys(client), names(fields));
        // The boxes and pairs of its last edit.
        for (field, expected) in [("frames", 5), ("edits", 4), ("boxes", 4), ("pairs", 3)] {
            assert_eq!(client[field], expected, "{field}: {client}");
        }
        let scene = &client["scenes"][0];
        let fields = "scene boxes moved_share pairs engine edits edits_per_second ingest_ns execute_ns \
                      memory_bytes";
        assert_eq!(keys(scene), names(fields));
        assert_eq!(
            (&scene["boxes"], &scene["pairs"], &scene["edits"]),
            (&4.into(), &3.into(), &4.into())
        );

        // Without a terminal it is as `--once`.
        for line in ["top --interval 20", "top --once --interval 20"] {
            let shown = sandbox.run_line(line);
            assert_eq!((shown.code, shown.stderr.as_str()), (Some(0), ""), "{shown:?}");
            let rows: Vec<&str> = shown.stdout.lines().collect();
            let head = rows.iter().position(|row| row.starts_with("CLIENT")).unwrap();
            assert!(rows[0].starts_with("default: alive") && rows[head].contains("FRM/S"));
            assert!(rows[head + 1].contains(" #") && rows[head + 2].starts_with(" scene "));
        }
    });
}

#[test]
fn a_killed_daemon_shows_its_last_counts() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "--gpu none", "default");
    with_load(&serving, || {});
    drop(serving);
    eventually("the worker ends", || sandbox.processes().is_empty().then_some(()));
    let report = sandbox.run_line("top --json --interval 1").json();
    assert_eq!((&report["state"], &report["totals"]["frames"]), (&"dead".into(), &6.into()));
    let shown = sandbox.run_line("top --once --interval 1");
    assert!(shown.stdout.contains("has exited: its last counts"), "{shown:?}");
}

#[test]
fn without_a_daemon_it_says_how_to_start_one() {
    let sandbox = Sandbox::new();
    let none = sandbox.run_line("top");
    assert!(none.error(1).contains("start one with `pairmaskd serve`"), "{none:?}");
    let serving = Serving::start(&sandbox, "--gpu none", "default");
    let other = sandbox.run_line("top --instance other");
    assert!(other.error(1).contains("pairmaskd serve --instance other"), "{other:?}");
    let wrong = sandbox.run_line("top --interval 0");
    assert!(wrong.error(2).contains("--interval"), "{wrong:?}");
    serving.stop(Signal::TERM);
    assert!(sandbox.run_line("top").error(1).contains("pairmaskd serve"));
}

/// Counters that a user cannot have are no reason not to serve.
#[test]
fn a_daemon_that_cannot_make_its_counters_serves_without_them() {
    let sandbox = Sandbox::new();
    std::fs::create_dir(sandbox.path().join("default.counters.new")).unwrap();
    let serving = Serving::start(&sandbox, "--gpu none", "default");
    with_load(&serving, || {
        let shown = sandbox.run_line("top --once --interval 1");
        assert!(shown.stdout.contains("no counters"), "{shown:?}");
        assert_eq!(sandbox.run_line("status --json").json()["instances"][0]["daemon"]["frames"], 5);
    });
    let finished = serving.stop(Signal::TERM);
    assert!(finished.stderr.contains("`pairmaskd top` will not see"), "{finished:?}");
}

/// Without the hangup's signal too, which comes to a terminal's own session alone.
#[test]
fn what_draws_ends_with_its_terminal() {
    for line in ["top --interval 50", "demo --seconds 1000 --boxes 100"] {
        let sandbox = Sandbox::new();
        let _serving = Serving::start(&sandbox, "--gpu none", "default");
        let (mut keyboard, side) = pty();
        let mut command = sandbox.line(line);
        command.env("TERM", "xterm").env_remove("NO_COLOR").stderr(Stdio::null());
        command.stdin(side.try_clone().unwrap()).stdout(side);
        let mut child = command.spawn().unwrap();
        // It has the program's side open.
        drop(command);
        let (mut printed, mut bytes) = (Vec::new(), [0; 4096]);
        while !String::from_utf8_lossy(&printed).contains("\x1b[?1049h") {
            let count = keyboard.read(&mut bytes).unwrap();
            printed.extend_from_slice(&bytes[..count]);
        }
        drop(keyboard);
        eventually("it ends", || child.try_wait().unwrap());
    }
}
