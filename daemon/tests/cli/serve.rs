//! `serve`: one daemon an instance, stopped by signals, restarted when it crashes.

use std::process::{Child, Stdio};

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::process::{Pid, Signal, kill_process};

use crate::support::{Finished, PAIRMASKD, Place, eventually, finish};

fn pid_of(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap()
}

fn serve(place: &Place, arguments: &[&str]) -> Child {
    let mut all = vec!["serve"];
    all.extend(arguments);
    let child = place.command(&all).spawn().unwrap();
    let name = arguments.iter().skip_while(|a| **a != "--instance").nth(1);
    let name: InstanceName = name.map_or_else(InstanceName::default, |n| n.parse().unwrap());
    let dir = RuntimeDir::at(place.path());
    eventually("the daemon serves", || dir.read_record(&name));
    child
}

fn stop(child: Child, signal: Signal) -> Finished {
    kill_process(pid_of(&child), signal).unwrap();
    finish(child)
}

#[test]
fn signals_stop_it_cleanly() {
    for signal in [Signal::TERM, Signal::INT] {
        let place = Place::new();
        let child = serve(&place, &[]);
        let finished = stop(child, signal);
        assert_eq!(finished.code, Some(0), "{finished:?}");
        assert!(finished.stderr.contains("serving 'default'"), "{finished:?}");
        assert!(RuntimeDir::at(place.path()).instances().is_empty());
        eventually("processes end", || place.processes().is_empty().then_some(()));
    }
}

#[test]
fn a_second_daemon_is_refused_and_another_instance_is_not() {
    let place = Place::new();
    let first = serve(&place, &[]);
    let refused = place.run(&["serve"]);
    let error = refused.error(1);
    assert!(error.contains("already served") && error.contains("--instance"), "{error}");
    assert!(error.contains(&first.id().to_string()), "{error}");
    let longest = "a-name-of-the-greatest-length-32";
    let other = serve(&place, &["--instance", longest]);
    assert_eq!(stop(other, Signal::TERM).code, Some(0));
    assert_eq!(stop(first, Signal::TERM).code, Some(0));
}

#[test]
fn a_directory_that_cannot_be_used_is_named() {
    let place = Place::new();
    std::fs::write(place.file("file"), "").unwrap();
    let finished = place.run(&["serve", "--runtime-dir", "file/below"]);
    assert!(finished.error(1).contains("file/below"), "{finished:?}");
}

#[test]
fn a_directory_may_have_a_longer_path_than_a_socket() {
    let place = Place::new();
    let long = place.file(&"x".repeat(200));
    let child = place.command(&["serve", "--runtime-dir", long.to_str().unwrap()]).spawn().unwrap();
    let dir = RuntimeDir::at(&long);
    eventually("the daemon serves", || dir.read_record(&InstanceName::default()));
    let status = place.run(&["status", "--runtime-dir", long.to_str().unwrap()]);
    assert_eq!(stop(child, Signal::TERM).code, Some(0));
    assert_eq!(status.code, Some(0), "{status:?}");
}

/// Runs the program in a shell that limits it.
fn limited(place: &Place, limits: &str, arguments: &str) -> Child {
    let mut command = std::process::Command::new("bash");
    command.args(["-c", &format!("{limits}; exec {PAIRMASKD} {arguments}")]);
    command.env("PAIRMASK_RUNTIME_DIR", place.path()).env("PAIRMASK_GPU", "none");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

#[test]
fn a_daemon_reserves_what_its_address_space_allows() {
    let place = Place::new();
    let child = limited(&place, "ulimit -v 8000000", "serve");
    let dir = RuntimeDir::at(place.path());
    eventually("the daemon serves", || dir.read_record(&InstanceName::default()));
    let builder = pairmask::Session::builder().runtime_dir(dir);
    let mut session = builder.backend(pairmask::Backend::Daemon).connect().unwrap();
    let mask = session.frame(100).unwrap().submit().unwrap().wait().unwrap();
    assert_eq!(mask.info().served_by, pairmask::ServedBy::Daemon);
    drop((mask, session));
    let finished = stop(child, Signal::TERM);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let warnings = finished.stderr.matches("RLIMIT_AS").count();
    assert_eq!(warnings, 1, "{finished:?}");
}

#[test]
fn more_clients_than_files_are_refused() {
    let place = Place::new();
    let finished = finish(limited(&place, "ulimit -n 1024", "serve --max-clients 200"));
    let error = finished.error(1);
    assert!(error.contains("200 clients") && error.contains("RLIMIT_NOFILE"), "{error}");
    assert!(error.contains("--max-clients 89"), "{error}");
    // The soft limit alone is raised.
    let child = limited(&place, "ulimit -Sn 64", "serve --max-clients 200");
    let dir = RuntimeDir::at(place.path());
    let record = eventually("the daemon serves", || dir.read_record(&InstanceName::default()));
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", record.worker_pid)).unwrap();
    let files = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    assert_ne!(files.split_whitespace().nth(3), Some("64"), "{files}");
    assert_eq!(stop(child, Signal::TERM).code, Some(0));
}
