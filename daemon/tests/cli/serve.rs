//! `serve`: one daemon an instance, stopped by signals, restarted when it crashes.

use std::process::{Child, Stdio};

use pairmask_transport::RuntimeDir;
use rustix::process::Signal;

use crate::support::{PAIRMASKD, Place, Serving, eventually, finish};

#[test]
fn signals_stop_it_cleanly() {
    for signal in [Signal::TERM, Signal::INT] {
        let place = Place::new();
        let finished = Serving::start(&place, "", "default").stop(signal);
        assert_eq!(finished.code, Some(0), "{finished:?}");
        assert!(finished.stderr.contains("serving 'default'"), "{finished:?}");
        assert!(RuntimeDir::at(place.path()).instances().is_empty());
        eventually("processes end", || place.processes().is_empty().then_some(()));
    }
}

#[test]
fn a_second_daemon_is_refused_and_another_instance_is_not() {
    let place = Place::new();
    let first = Serving::start(&place, "", "default");
    let refused = place.run_line("serve");
    let error = refused.error(1);
    assert!(error.contains("already served") && error.contains("--instance"), "{error}");
    assert!(error.contains(&first.id().to_string()), "{error}");
    let longest = "a-name-of-the-greatest-length-32";
    let other = Serving::start(&place, &format!("--instance {longest}"), longest);
    for serving in [other, first] {
        assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    }
}

#[test]
fn a_directory_that_cannot_be_used_is_named() {
    let place = Place::new();
    std::fs::write(place.file("file"), "").unwrap();
    let finished = place.run_line("serve --runtime-dir file/below");
    assert!(finished.error(1).contains("file/below"), "{finished:?}");
}

#[test]
fn a_directory_may_have_a_longer_path_than_a_socket() {
    let place = Place::new();
    let long = place.file(&"x".repeat(200));
    let at_it = |command: &str| format!("{command} --runtime-dir {}", long.display());
    let child = place.line(&at_it("serve")).spawn().unwrap();
    let serving = Serving::of(child, RuntimeDir::at(&long), "default");
    let status = place.run_line(&at_it("status"));
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
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
    let serving = Serving::of(child, RuntimeDir::at(place.path()), "default");
    let mut session = serving.session();
    let mask = session.frame(100).unwrap().submit().unwrap().wait().unwrap();
    assert_eq!(mask.info().served_by, pairmask::ServedBy::Daemon);
    drop((mask, session));
    let finished = serving.stop(Signal::TERM);
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
    let serving = Serving::of(child, RuntimeDir::at(place.path()), "default");
    let limits = format!("/proc/{}/limits", serving.record().worker_pid);
    let limits = std::fs::read_to_string(limits).unwrap();
    let files = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    assert_ne!(files.split_whitespace().nth(3), Some("64"), "{files}");
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
}
