//! `demo`: its own daemon, a summary, a picture, and nothing left; a terminal that is as before.

use std::os::unix::fs::PermissionsExt;

use rustix::process::{Pid, Signal, kill_process};

use crate::support::{Sandbox, Terminal, eventually, finish, keys, names, run_with, words};

#[test]
fn ends_by_itself_with_every_sample_right_and_no_frame_lost() {
    let sandbox = Sandbox::new();
    let finished = sandbox.run_line("demo --seconds 3 --boxes 300 --picture demo.svg");
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert_eq!(finished.stderr, "", "the daemon says nothing of its worker's end");
    let text = &finished.stdout;
    assert!(text.contains("300 boxes") && text.contains("p99"), "a line a second: {text}");
    let begins = |start: &str| text.lines().find(|line| line.starts_with(start)).unwrap();
    assert!(begins("frames ").contains(", none lost, "), "{text}");
    assert!(begins("worker ").contains("killed at 1.5 s"), "{text}");
    assert!(begins("this machine ").contains(" × parry3d, "), "{text}");
    let checks = begins("checks ");
    assert!(checks.ends_with("frames checked, all right"), "{text}");
    assert!(!checks.contains(" 0 frames"), "{text}");
    let next: Vec<&str> = text.lines().skip_while(|line| *line != "next").skip(1).collect();
    assert!(next.len() == 3 && next.iter().all(|line| line.contains("pairmaskd ")), "{text}");
    let picture = std::fs::read_to_string(sandbox.file("demo.svg")).unwrap();
    assert!(picture.starts_with("<svg ") && picture.contains("300 boxes, "), "{picture}");
    sandbox.assert_clean(&["demo.svg"]);
}

#[test]
fn json_is_one_object_with_what_was_measured() {
    let sandbox = Sandbox::new();
    let finished = sandbox.run_line("demo --seconds 2 --boxes 100 --json");
    let report = finished.json();
    let fields = "boxes seconds frames frames_in_process checked pairs engine worker_killed frame_ns \
                  parry3d_ns naive_ns";
    assert_eq!(keys(&report), names(fields));
    assert_eq!((&report["boxes"], &report["worker_killed"]), (&100.into(), &true.into()));
    assert_eq!(keys(&report["frame_ns"]), names("p50 p90 p99 p999 max"));
    assert!(report["parry3d_ns"].as_u64() > Some(0) && report["naive_ns"].as_u64() > Some(0));
    assert!(finished.stderr.contains("100 boxes"), "progress: {finished:?}");
}

#[test]
fn nothing_outlives_a_demo_that_a_signal_ends() {
    for signal in [Signal::TERM, Signal::KILL] {
        let sandbox = Sandbox::new();
        let child = sandbox.line("demo --seconds 1000 --boxes 50").spawn().unwrap();
        let is_worker = |process: &String| process.contains("--worker");
        eventually("the daemon serves", || sandbox.processes().iter().any(is_worker).then_some(()));
        std::thread::sleep(std::time::Duration::from_millis(300));
        kill_process(Pid::from_raw(child.id().cast_signed()).unwrap(), signal).unwrap();
        let finished = finish(child);
        if signal == Signal::TERM {
            assert_eq!(finished.code, Some(0), "{finished:?}");
            assert!(finished.stdout.contains("checks "), "its summary: {finished:?}");
        }
        sandbox.assert_clean(&[]);
    }
}

#[test]
fn a_terminal_is_drawn_on_and_is_as_before_when_the_user_quits() {
    const ENTER: &str = "\x1b[?1049h";
    const LEAVE: &str = "\x1b[?1049l";
    for quit in ["q", "\x03", "SIGTERM"] {
        let (sandbox, terminal) = (Sandbox::new(), Terminal::new());
        let before = terminal.modes();
        let mut command = sandbox.line("demo --seconds 1000 --boxes 200");
        command.env("TERM", "xterm-256color");
        let (code, stderr) = terminal.run(command, |process| {
            let is_drawn = || terminal.printed().contains("parry3d").then_some(());
            eventually("the demo draws", is_drawn);
            assert_ne!(terminal.modes().local_modes, before.local_modes, "keys come one by one");
            if quit == "SIGTERM" {
                let process = Pid::from_raw(process.cast_signed()).unwrap();
                kill_process(process, Signal::TERM).unwrap();
            } else {
                terminal.press(quit.as_bytes());
            }
        });
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{quit:?}");
        let after = terminal.modes();
        assert_eq!(after.local_modes, before.local_modes, "{quit:?}");
        assert_eq!(after.input_modes, before.input_modes, "{quit:?}");
        let printed = terminal.close();
        assert_eq!((printed.matches(ENTER).count(), printed.matches(LEAVE).count()), (1, 1));
        let (drawn, rest) = printed.split_once(LEAVE).unwrap();
        assert!(drawn.contains("parry3d") && !drawn.contains("checks "), "{drawn}");
        assert!(rest.contains("checks ") && rest.contains("next"), "its summary: {rest}");
        sandbox.assert_clean(&[]);
    }
}

#[test]
fn a_terminal_without_colours_gets_plain_lines() {
    for (variable, value) in [("NO_COLOR", "1"), ("TERM", "dumb")] {
        let (sandbox, terminal) = (Sandbox::new(), Terminal::new());
        let mut command = sandbox.line("demo --seconds 2 --boxes 50");
        command.env("TERM", "xterm-256color").env(variable, value);
        let (code, stderr) = terminal.run(command, |_| ());
        assert_eq!((code, stderr.as_str()), (Some(0), ""));
        let printed = terminal.close();
        assert!(printed.contains("frames, none lost") && printed.contains("checks "), "{printed}");
        assert!(!printed.contains('\x1b'), "{printed}");
    }
}

/// A folder with a `python3` that is this shell script.
fn python(sandbox: &Sandbox, name: &str, script: &str) -> String {
    let folder = sandbox.file(name);
    std::fs::create_dir(&folder).unwrap();
    let program = folder.join("python3");
    std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:/usr/bin:/bin", folder.display())
}

#[test]
fn a_recording_gets_every_other_frame_whole() {
    let sandbox = Sandbox::new();
    // $3 is the recording; what comes on stdin is kept.
    let path = python(&sandbox, "keeps", "echo ready; exec cat > \"$3\"");
    let line = "demo --seconds 2 --boxes 100 --json --rerun demo.rrd";
    let finished = run_with(&sandbox, line, &[("PATH", &path)]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let words = words(&sandbox.file("demo.rrd"));
    let (mut at, mut frames, mut pairs) = (0, Vec::new(), 0);
    while at < words.len() {
        let [frame, n, m] = words[at..at + 3] else { panic!("a head") };
        assert_eq!(n, 100);
        at += 3 + 6 * n as usize;
        let indices = &words[at..at + 2 * m as usize];
        assert!(indices.iter().all(|index| *index < n), "{indices:?}");
        at += indices.len();
        frames.push(frame);
        pairs += m;
    }
    let all = finished.json()["frames"].as_u64().unwrap() as u32;
    assert_eq!(frames, (1..=all).filter(|frame| frame % 2 == 0).collect::<Vec<u32>>());
    assert!(pairs > 0);
}

#[test]
fn a_recording_without_python_its_package_or_an_end_is_an_error() {
    let line = "demo --seconds 1 --boxes 50 --rerun demo.rrd";
    for (name, script, says) in [
        (
            "lacks",
            "echo \"No module named 'rerun'\" >&2; exit 1",
            "No module named 'rerun': it needs",
        ),
        ("dies", "echo ready; echo 'no space' >&2; exit 1", "writing the recording: no space"),
    ] {
        let sandbox = Sandbox::new();
        let path = python(&sandbox, name, script);
        let finished = run_with(&sandbox, line, &[("PATH", &path)]);
        assert_eq!(finished.code, Some(1), "{finished:?}");
        assert!(finished.stderr.contains(says), "{finished:?}");
    }
    let sandbox = Sandbox::new();
    let finished = run_with(&sandbox, line, &[("PATH", "")]);
    assert_eq!(finished.code, Some(1), "{finished:?}");
    assert!(finished.stderr.contains("pip install rerun-sdk"), "{finished:?}");
}
