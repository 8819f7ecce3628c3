//! `demo`: its own daemon, a summary, and nothing left.

use rustix::process::{Pid, Signal, kill_process};

use crate::support::{Sandbox, eventually, finish};

#[test]
fn ends_by_itself_with_every_sample_right() {
    let sandbox = Sandbox::new();
    let finished = sandbox.run_line("demo --seconds 2 --boxes 300");
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let text = &finished.stdout;
    assert!(text.contains("frames/s") && text.contains("p99"), "a line a second: {text}");
    let summary = text.lines().find(|line| line.starts_with("frames ")).unwrap();
    assert!(summary.ends_with(", 0 of them in process"), "{text}");
    let checks = text.lines().find(|line| line.starts_with("checks ")).unwrap();
    assert!(checks.ends_with("frames checked, all right"), "{text}");
    assert!(!checks.contains(" 0 frames"), "{text}");
    sandbox.assert_clean(&[]);
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
