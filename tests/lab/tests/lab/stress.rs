//! `stress`: a broken engine is caught and reported, a right one passes; clients of a daemon too.

use std::collections::BTreeSet;

use pairmask_tests::command_line::{self, Finished, eventually, finish};
use pairmask_transport::RuntimeDir;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::support::{LosingDaemon, Sandbox, keys, names};

/// Runs in which an auditor is to notice a lost pair. Beside four busy threads on two cores it notices in
/// three of four runs.
const MOST_AUDITED_RUNS: usize = 20;

#[test]
fn what_is_broken_is_caught_within_seconds_and_replayed() {
    let sandbox = Sandbox::new();
    for (line, broken, modes, what) in [
        ("--engine cpu-sap --mode exact", "--break-engine", &["exact"][..], "is missing"),
        ("--mode q8,f16,f64", "--break-engine=inward", &["q8", "f16", "f64"], "mode"),
    ] {
        let line = format!("stress --seconds 60 {line} {broken} --json");
        let finished = sandbox.run_line(&line);
        assert_eq!(finished.code, Some(1), "{finished:?}");
        let report: Value = serde_json::from_str(&finished.stdout).unwrap();
        let fields = "seed subjects cases answers skipped missed extra elapsed_ns failures clients";
        assert_eq!(keys(&report), names(fields));
        assert_eq!(report["clients"], Value::Null);
        // Ten wrong answers end a run long before its time.
        assert!(report["elapsed_ns"].as_u64().unwrap() < 55_000_000_000, "{report}");
        assert!(report["missed"].as_u64().unwrap() > 0 && report["extra"] == 0, "{report}");
        let failure = &report["failures"][0];
        let fields = "case subject mode replay boxes scene flags what missed extra pair explain";
        assert_eq!(keys(failure), names(fields));
        let mode = failure["mode"].as_str().unwrap();
        assert!(modes.contains(&mode) && failure["explain"]["overlaps"] == true, "{failure}");

        // The command that is printed, word by word.
        let replay: Vec<&str> = failure["replay"].as_str().unwrap().split(' ').skip(1).collect();
        let again = sandbox.run(&[&replay[..], &[broken]].concat());
        assert_eq!(again.code, Some(1), "{again:?}");
        for part in [what, "IN the mask", &format!("mode {mode}")] {
            assert!(again.stdout.contains(part), "{part}: {again:?}");
        }
        assert_eq!(sandbox.run(&replay).code, Some(0), "as it is it answers the case");
    }
}

/// The fields of `clients`, and of its `daemon`.
const CLIENTS: &str =
    "count sessions frames edits queries unread in_process unanswered killed broken daemon";
const DAEMON: &str = "serves was_restarted frames errors audit";

/// Runs of clients that are killed, of which one is to succeed: once in some dozens the transport gives the answer
/// to a killed client to the next one in its place, which sees that and answers its frame itself.
const MOST_RUNS_WITH_KILLS: usize = 3;

/// Runs four clients of a daemon with this GPU, some of them killed, and checks the report.
fn four_clients(gpu: &str) -> Value {
    let sandbox = Sandbox::new();
    let line = ["stress", "--clients", "4", "--seconds", "4", "--seed", "9", "--kills", "--json"];
    let run = || {
        let mut command = sandbox.command(&[&line[..], &["--gpu", gpu]].concat());
        // Mesa's device-select layer would hide the adapter where no display server runs.
        command.env("NODEVICE_SELECT", "1");
        finish(command.spawn().unwrap(), "pairmask-lab")
    };
    let is_misled = |run: &Finished| run.stderr.contains("the response is for another client");
    let mut runs = std::iter::repeat_with(run).take(MOST_RUNS_WITH_KILLS);
    let report = runs.find(|run| !is_misled(run)).expect("a run without a misled answer").json();
    let count = |value: &Value| value.as_u64().unwrap();
    assert!(count(&report["answers"]) > 50 && count(&report["cases"]) >= 20, "{report}");
    assert_eq!((&report["missed"], &report["extra"]), (&0.into(), &0.into()));
    let clients = &report["clients"];
    assert_eq!(keys(clients), names(CLIENTS));
    assert_eq!((&clients["in_process"], &clients["unanswered"]), (&0.into(), &0.into()));
    assert!(clients["count"] == 4 && count(&clients["killed"]) > 0, "{report}");
    let (frames, edits) = (count(&clients["frames"]), count(&clients["edits"]));
    assert!(edits > 10 && frames + edits > count(&report["answers"]), "{report}");
    assert_eq!(clients["broken"], Value::Array(vec![]));
    let daemon = &clients["daemon"];
    assert_eq!(keys(daemon), names(DAEMON));
    assert!(daemon["serves"] == true && daemon["was_restarted"] == false, "{report}");
    let audit = &daemon["audit"];
    assert!(count(&audit["frames"]) > 0 && count(&audit["pairs"]) > 0, "{report}");
    assert_eq!((&audit["missed"], &audit["extra"]), (&0.into(), &0.into()));
    sandbox.assert_clean(&[]);
    report
}

fn asked(report: &Value) -> BTreeSet<&str> {
    report["subjects"].as_array().unwrap().iter().map(|subject| subject.as_str().unwrap()).collect()
}

#[test]
fn clients_of_a_daemon_get_their_own_pairs() {
    let report = four_clients("none");
    let asked = asked(&report);
    assert!(asked.contains("boxes by auto") && asked.contains("spheres by cpu-grid"), "{asked:?}");
    assert!(asked.contains("scenes by auto"), "{asked:?}");
    assert!(!asked.iter().any(|name| name.contains("gpu")), "{asked:?}");
}

#[test]
fn clients_of_a_daemon_with_a_gpu_get_their_own_pairs() {
    let report = four_clients(&pairmask_tests::gpu::choice().to_string());
    let asked = asked(&report);
    assert!(asked.contains("boxes by gpu-grid") && asked.contains("q8 by gpu-brute"), "{asked:?}");
}

#[test]
fn clients_notice_a_daemon_that_loses_pairs() {
    let daemon = command_line::Sandbox::<LosingDaemon>::new();
    let serve = ["serve", "--audit", "1/1", "--max-clients", "64"];
    let serving = daemon.command(&serve).spawn().unwrap();
    let (dir, name) = (RuntimeDir::at(daemon.path()), "default".parse().unwrap());
    eventually("the daemon serves", || dir.read_record(&name));

    let sandbox = Sandbox::new();
    let run = |line: &[&str]| {
        let mut command = sandbox.command(&[line, &["--json"]].concat());
        command.env("PAIRMASK_RUNTIME_DIR", daemon.path());
        let finished = finish(command.spawn().unwrap(), "pairmask-lab");
        assert_eq!(finished.code, Some(1), "{finished:?}");
        serde_json::from_str::<Value>(&finished.stdout).unwrap()
    };
    let line = ["stress", "--clients", "2", "--instance", "default", "--seconds", "60"];
    let report = run(&[&line[..], &["--mode", "exact"]].concat());
    assert!(report["elapsed_ns"].as_u64().unwrap() < 55_000_000_000, "{report}");
    assert!(report["missed"].as_u64().unwrap() > 0 && report["extra"] == 0, "{report}");
    let failure = &report["failures"][0];
    assert!(failure["what"].as_str().unwrap().contains("is missing"), "{failure}");

    // The command that is printed, word by word.
    let replay: Vec<&str> = failure["replay"].as_str().unwrap().split(' ').skip(1).collect();
    assert!(replay.contains(&"--clients") && replay.contains(&"--instance"), "{failure}");
    let again = run(&replay);
    let of_the_case = |found: &Value| found["case"] == failure["case"];
    assert!(again["failures"].as_array().unwrap().iter().any(of_the_case), "{again}");

    // A run ends with its tenth wrong answer, by which time an auditor of the lowest priority has checked few
    // frames, or none, where the machine is busy.
    let is_audited =
        |report: &Value| report["clients"]["daemon"]["audit"]["missed"].as_u64().unwrap() > 0;
    let mut more_runs = std::iter::repeat_with(|| run(&replay)).take(MOST_AUDITED_RUNS);
    let reports = [&report, &again];
    let noticed =
        reports.into_iter().any(is_audited) || more_runs.any(|report| is_audited(&report));
    assert!(noticed, "no auditor noticed in {MOST_AUDITED_RUNS} runs and {report}");

    kill_process(Pid::from_raw(serving.id().cast_signed()).unwrap(), Signal::TERM).unwrap();
    assert_eq!(finish(serving, "pairmaskd").code, Some(0));
}
