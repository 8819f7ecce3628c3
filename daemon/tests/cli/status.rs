//! `status`: no daemon, a living one, and one that died.

use pairmask_core::Aabb;
use pairmaskd::spawn::PrivateDaemon;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::support::{
    Finished, PAIRMASKD, Sandbox, Serving, daemon, eventually, keys, names, stop,
};

fn status(sandbox: &Sandbox, daemon: &PrivateDaemon, more: &str) -> Finished {
    sandbox.run_line(&format!("status --runtime-dir {} {more}", daemon.dir().path().display()))
}

/// The report of a command that failed.
fn failed(finished: &Finished) -> Value {
    assert_eq!(finished.code, Some(1), "{finished:?}");
    serde_json::from_str(&finished.stdout).unwrap()
}

#[test]
fn no_daemon_serves() {
    let sandbox = Sandbox::new();
    let finished = sandbox.run_line("status");
    assert!(finished.error(1).contains("pairmaskd serve"), "{finished:?}");
    let report = failed(&sandbox.run_line("status --json"));
    assert_eq!(report["instances"], Value::Array(vec![]));
    assert_eq!(report["runtime_dir"], sandbox.path().to_str().unwrap());
}

#[test]
fn a_daemon_reports_what_it_did() {
    let sandbox = Sandbox::new();
    let daemon = daemon();
    let mut session = daemon.session().connect().unwrap();
    for _ in 0..3 {
        let mut frame = session.frame(4).unwrap();
        frame.boxes_mut().fill(Aabb::from([0.0; 6]));
        frame.submit().unwrap().wait().unwrap();
    }
    let report = status(&sandbox, &daemon, "--json").json();
    let instance = &report["instances"][0];
    let fields = "instance state version pid supervisor_pid fences daemon problem counters";
    assert_eq!(keys(instance), names(fields));
    assert_eq!((&instance["instance"], &instance["state"]), (&"default".into(), &"alive".into()));
    assert_eq!(instance["pid"], daemon.record().unwrap().worker_pid);
    let reported = &instance["daemon"];
    let fields = "age_ns uptime_ns cpu_ns clients gpus_opening gpus frames boxes spheres pairs scenes \
                  scene_mib repeats skipped errors last_errors audit";
    assert_eq!(keys(reported), names(fields));
    // The third frame is equal to the second.
    for (field, expected) in [
        ("/spheres", 0),
        ("/scenes", 0),
        ("/frames", 3),
        ("/pairs", 18),
        ("/boxes", 12),
        ("/clients", 1),
        ("/errors", 0),
        ("/gpus", 0),
        ("/gpus_opening", 0),
        ("/repeats", 1),
        ("/skipped/boxes", 4),
        ("/skipped/pairs", 6),
        ("/skipped/why/unmoved", 6),
    ] {
        assert_eq!(reported.pointer(field), Some(&expected.into()), "{field}");
    }
    assert_eq!(reported["audit"], Value::Null);

    let is_shown = |text: &str| {
        let status = status(&sandbox, &daemon, "");
        assert!(status.stdout.contains(text), "{text}: {status:?}");
    };
    let counters = &instance["counters"];
    assert_eq!(keys(counters), names("totals clients shared_scenes"));
    let [client] = &counters["clients"].as_array().unwrap()[..] else { panic!("{counters}") };
    for (field, expected) in [("boxes", 4), ("pairs", 6), ("frames", 3), ("errors", 0)] {
        assert_eq!(client[field], expected, "{field}");
    }
    assert_eq!(client["process"], std::process::id());
    assert_eq!(counters["totals"]["frames"], 3);

    is_shown("default: alive");
    is_shown(&format!("process {}: 0.0 frames/s, 4 boxes, 6 pairs by ", std::process::id()));
    is_shown("3 frames, 12 boxes, 18 pairs");
    let mut frame = session.sphere_frame(5).unwrap();
    frame.spheres_mut().fill(pairmask_core::Sphere::new([0.0; 3], 1.0));
    frame.submit().unwrap().wait().unwrap();
    is_shown("4 frames, 12 boxes, 5 spheres, 28 pairs");
    let mut scene = session.scene(pairmask::SceneOptions::default()).unwrap();
    let edit = scene.edit().set(0, Aabb::EMPTY);
    drop(edit.commit(pairmask::Report::All).unwrap());
    is_shown("1 scenes of 1 MiB");
    let other = status(&sandbox, &daemon, "--instance other");
    assert!(other.error(1).contains("instance 'other'"), "{other:?}");
    assert!(other.error(1).contains("pairmaskd serve --instance other"), "{other:?}");
}

#[test]
fn refused_requests_are_remembered() {
    let sandbox = Sandbox::new();
    let daemon = daemon();
    let engine = "gpu-grid".parse().unwrap();
    let mut session = daemon.session().engine(engine).connect().unwrap();
    session.frame(1).unwrap().submit().unwrap().wait().unwrap_err();
    let report = status(&sandbox, &daemon, "--json").json();
    let reported = &report["instances"][0]["daemon"];
    assert_eq!(reported["errors"], 1);
    let error = &reported["last_errors"][0];
    assert_eq!(keys(error), names("status ago_ns client frame"));
    assert_eq!(error["status"], "engine-unavailable");
    assert_eq!(reported["last_errors"].as_array().unwrap().len(), 1);
}

#[test]
fn a_killed_daemon_is_dead() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "", "default");
    let record = serving.record();
    drop(serving);
    eventually("the worker ends", || sandbox.processes().is_empty().then_some(()));
    let report = failed(&sandbox.run_line("status --json"));
    let instance = &report["instances"][0];
    assert_eq!((&instance["state"], &instance["daemon"]), (&"dead".into(), &Value::Null));
    assert_eq!(instance["pid"], record.worker_pid);
    assert_eq!(instance["counters"]["totals"]["errors"], 0, "its counters stay");
}

#[test]
fn a_hanging_daemon_is_silent() {
    let sandbox = Sandbox::new();
    let daemon = daemon();
    // The supervisor would replace its worker.
    let record = daemon.record().unwrap();
    let processes = [record.supervisor_pid, record.worker_pid]
        .map(|pid| Pid::from_raw(pid.cast_signed()).unwrap());
    for pid in processes {
        stop(pid);
    }
    let finished = status(&sandbox, &daemon, "--json");
    for pid in processes {
        kill_process(pid, Signal::CONT).unwrap();
    }
    let report = failed(&finished);
    let instance = &report["instances"][0];
    assert_eq!(instance["state"], "silent");
    let problem = instance["problem"].as_str().unwrap();
    assert!(problem.contains("instance 'default'"), "{report}");
    assert!(problem.contains("its heartbeat stands still"), "{report}");
    // The last known figures and their age: the command waited three seconds at least.
    assert_eq!(instance["daemon"]["errors"], 0);
    assert!(instance["daemon"]["age_ns"].as_u64().unwrap() >= 3_000_000_000, "{report}");
}

/// In a container that was moved from another machine, clocks differ from those outside.
#[test]
fn a_daemon_answers_in_other_namespaces() {
    let daemon = daemon();
    for namespace in [
        &["--time", "--boottime", "1000000", "--monotonic", "1000000"][..],
        &["--pid", "--fork", "--mount-proc"],
    ] {
        let mut command = std::process::Command::new("unshare");
        command.args(["--user", "--map-root-user"]).args(namespace);
        command.args([PAIRMASKD, "status"]).env("PAIRMASK_RUNTIME_DIR", daemon.dir().path());
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains("default: alive"), "{output:?}");
    }
}

#[test]
fn a_daemon_with_all_the_clients_that_it_may_have_answers() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "--max-clients 1", "default");
    let mut session = serving.session();
    session.frame(1).unwrap().submit().unwrap().wait().unwrap();
    for _ in 0..2 {
        let report = sandbox.run_line("status --json").json();
        let instance = &report["instances"][0];
        assert_eq!(instance["state"], "alive", "{report}");
        assert_eq!(instance["daemon"]["clients"], 1, "{report}");
        assert_eq!(instance["daemon"]["frames"], 1, "{report}");
    }
    drop(session);
    let dir = serving.dir.clone();
    serving.stop(Signal::TERM);
    assert_eq!(dir.read_status(&"default".parse().unwrap()).unwrap(), None, "it was left behind");
}

/// A daemon without a status file, as earlier versions have none, is asked over the wire.
#[test]
fn a_daemon_without_a_status_file_is_asked() {
    let sandbox = Sandbox::new();
    let daemon = daemon();
    // A directory in the place of a new status file, so that none can be written.
    let new = daemon.dir().path().join("default.account.new");
    eventually("no status file can be written", || std::fs::create_dir(&new).ok());
    std::fs::remove_file(daemon.dir().path().join("default.account")).unwrap();
    let report = status(&sandbox, &daemon, "--json").json();
    assert_eq!(report["instances"][0]["state"], "alive", "{report}");
    assert_eq!(report["instances"][0]["daemon"]["clients"], 0, "{report}");
}
