//! `serve`: one daemon an instance, stopped by signals, restarted when it crashes.

use std::path::Path;
use std::process::{Child, Stdio};

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::process::{Pid, Signal, kill_process};

use crate::support::{PAIRMASKD, Sandbox, Serving, eventually, finish};

#[test]
fn signals_stop_it_cleanly() {
    for signal in [Signal::TERM, Signal::INT, Signal::HUP] {
        let sandbox = Sandbox::new();
        let finished = Serving::start(&sandbox, "", "default").stop(signal);
        assert_eq!(finished.code, Some(0), "{finished:?}");
        assert!(finished.stderr.contains("serving 'default'"), "{finished:?}");
        assert_leaves_nothing(&sandbox);
        eventually("processes end", || sandbox.processes().is_empty().then_some(()));
    }
}

/// No socket, no record, no name in /dev/shm. The lock of an instance stays.
fn assert_leaves_nothing(sandbox: &Sandbox) {
    let dir = RuntimeDir::at(sandbox.path());
    assert!(dir.instances().is_empty());
    let prefix = dir.shm_prefix(&InstanceName::default());
    let names = [(sandbox.path(), "default."), (Path::new("/dev/shm"), prefix.as_str())];
    for (folder, beginning) in names {
        let entries = std::fs::read_dir(folder).unwrap().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let left: Vec<_> = names.filter(|name| name.starts_with(beginning)).collect();
        assert!(left.iter().all(|name| name == "default.lock"), "{left:?}");
    }
}

/// A terminal that is closed sends it to both processes. `nohup` has them ignore it.
#[test]
fn the_end_of_its_terminal_stops_it_but_with_nohup() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "", "default");
    let _session = serving.session();
    kill_process(Pid::from_raw(serving.record().worker_pid.cast_signed()).unwrap(), Signal::HUP)
        .unwrap();
    let finished = serving.stop(Signal::HUP);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert_leaves_nothing(&sandbox);

    let child = limited(&sandbox, "trap '' HUP", "serve");
    let serving = Serving::of(child, RuntimeDir::at(sandbox.path()), "default");
    for process in [serving.id(), serving.record().worker_pid] {
        let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
        let ignored = status.lines().find(|line| line.starts_with("SigIgn:")).unwrap();
        // SIGHUP is the first signal.
        assert!(ignored.ends_with(['1', '3', '5', '7', '9', 'b', 'd', 'f']), "{ignored}");
    }
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
}

#[test]
fn a_second_daemon_is_refused_and_another_instance_is_not() {
    let sandbox = Sandbox::new();
    let first = Serving::start(&sandbox, "", "default");
    let refused = sandbox.run_line("serve");
    let error = refused.error(1);
    assert!(error.contains("already served") && error.contains("--instance"), "{error}");
    assert!(error.contains(&first.id().to_string()), "{error}");
    let longest = "a-name-of-the-greatest-length-32";
    let other = Serving::start(&sandbox, &format!("--instance {longest}"), longest);
    for serving in [other, first] {
        assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    }
}

#[test]
fn a_directory_that_cannot_be_used_is_named() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.file("file"), "").unwrap();
    let finished = sandbox.run_line("serve --runtime-dir file/below");
    assert!(finished.error(1).contains("file/below"), "{finished:?}");
}

#[test]
fn a_directory_may_have_a_longer_path_than_a_socket() {
    let sandbox = Sandbox::new();
    let long = sandbox.file(&"x".repeat(200));
    let at_it = |command: &str| format!("{command} --runtime-dir {}", long.display());
    let child = sandbox.line(&at_it("serve")).spawn().unwrap();
    let serving = Serving::of(child, RuntimeDir::at(&long), "default");
    let status = sandbox.run_line(&at_it("status"));
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    assert_eq!(status.code, Some(0), "{status:?}");
}

/// Runs the program in a shell that limits it.
fn limited(sandbox: &Sandbox, limits: &str, arguments: &str) -> Child {
    let mut command = std::process::Command::new("bash");
    command.args(["-c", &format!("{limits}; exec {PAIRMASKD} {arguments}")]);
    command.env("PAIRMASK_RUNTIME_DIR", sandbox.path()).env("PAIRMASK_GPU", "none");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

#[test]
fn a_daemon_serves_in_little_address_space() {
    let sandbox = Sandbox::new();
    let child = limited(&sandbox, "ulimit -v 8000000", "serve");
    let serving = Serving::of(child, RuntimeDir::at(sandbox.path()), "default");
    let mut session = serving.session();
    let mask = session.frame(100).unwrap().submit().unwrap().wait().unwrap();
    assert_eq!(mask.info().served_by, pairmask::ServedBy::Daemon);
    drop((mask, session));
    let finished = serving.stop(Signal::TERM);
    assert_eq!(finished.code, Some(0), "{finished:?}");
}

#[test]
fn more_clients_than_files_are_refused() {
    let sandbox = Sandbox::new();
    let finished = finish(limited(&sandbox, "ulimit -n 1024", "serve --max-clients 200"));
    let error = finished.error(1);
    assert!(error.contains("200 clients") && error.contains("RLIMIT_NOFILE"), "{error}");
    assert!(error.contains("--max-clients 56"), "{error}");
    // The soft limit alone is raised.
    let child = limited(&sandbox, "ulimit -Sn 64", "serve --max-clients 200");
    let serving = Serving::of(child, RuntimeDir::at(sandbox.path()), "default");
    let limits = format!("/proc/{}/limits", serving.record().worker_pid);
    let limits = std::fs::read_to_string(limits).unwrap();
    let files = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    assert_ne!(files.split_whitespace().nth(3), Some("64"), "{files}");
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
}
