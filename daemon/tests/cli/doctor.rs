//! `doctor`: set-ups that are broken in earnest, each named; and the file for a bug report.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};

use rustix::process::Signal;
use serde_json::Value;

use crate::support::{
    Finished, PAIRMASKD, Sandbox, Serving, eventually, finish, keys, names, run_with,
};

fn doctor(sandbox: &Sandbox, line: &str, variables: &[(&str, &str)]) -> Finished {
    run_with(sandbox, &format!("doctor --json {line}"), variables)
}

/// The report's entries of a check.
fn entries(finished: &Finished, check: &str) -> Vec<Value> {
    let report: Value = serde_json::from_str(&finished.stdout).unwrap();
    assert_eq!(keys(&report), names("problems warnings checks"));
    let is_problem = report["problems"] != 0;
    assert_eq!(finished.code, Some(i32::from(is_problem)), "{finished:?}");
    assert_eq!(finished.stderr.is_empty(), !is_problem, "{finished:?}");
    let all = report["checks"].as_array().unwrap().iter();
    let found: Vec<Value> = all.filter(|entry| entry["check"] == check).cloned().collect();
    assert!(!found.is_empty(), "{check}: {report}");
    found
}

fn check(finished: &Finished, check: &str, state: &str, cause: &str, cure: &str) {
    let found = entries(finished, check);
    let has = |entry: &Value, key: &str, text: &str| {
        entry[key].as_str().is_some_and(|said| said.contains(text))
    };
    let is_it = |entry: &&Value| {
        entry["state"] == state && has(entry, "cause", cause) && has(entry, "cure", cure)
    };
    assert!(found.iter().any(|entry| is_it(&entry)), "{check}, {cause}: {found:#?}");
}

fn is_ok(finished: &Finished, check: &str) -> bool {
    entries(finished, check).iter().all(|entry| entry["state"] == "ok")
}

/// A line in a shell that limits it, with an environment of the sandbox's alone.
fn in_shell(sandbox: &Sandbox, before: &str) -> Finished {
    let mut command = Command::new("bash");
    command.args(["-c", &format!("{before} {PAIRMASKD} doctor --json")]).env_clear();
    command.env("PATH", std::env::var_os("PATH").unwrap_or_default());
    command.env("PAIRMASK_RUNTIME_DIR", sandbox.path()).env("PAIRMASK_GPU", "none");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    finish(command.spawn().unwrap())
}

#[test]
fn a_daemon_that_serves_is_well() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "", "default");
    let finished = doctor(&sandbox, "", &[]);
    for check in ["runtime-dir", "daemon", "pid-namespace", "instruction-set", "gpu"] {
        assert!(is_ok(&finished, check), "{check}: {finished:?}");
    }
    let seen = entries(&finished, "daemon")[0]["seen"].as_str().unwrap().to_owned();
    assert!(seen.contains(&format!("process {}", serving.record().worker_pid)), "{seen}");
    let fields = names("check state seen cause cure");
    assert_eq!(keys(&entries(&finished, "fences")[0]), fields);
    let text = sandbox.run_line("doctor").stdout;
    assert!(text.contains("ok       daemon: 'default' alive"), "{text}");
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    let finished = doctor(&sandbox, "--instance nobody-serves-this", &[]);
    check(&finished, "daemon", "warning", "no daemon serves 'nobody-", "pairmaskd serve");
}

#[test]
fn a_runtime_directory_that_is_not_ones_own_is_named() {
    let sandbox = Sandbox::new();
    let at =
        |dir: &std::path::Path| doctor(&sandbox, &format!("--runtime-dir {}", dir.display()), &[]);
    let open = sandbox.file("open");
    std::fs::create_dir(&open).unwrap();
    std::fs::set_permissions(&open, Permissions::from_mode(0o777)).unwrap();
    check(&at(&open), "runtime-dir", "problem", "open to other users (mode 777)", "chmod 700");
    let file = sandbox.file("file");
    std::fs::write(&file, "").unwrap();
    check(&at(&file), "runtime-dir", "problem", "is no directory", "remove it");
    // Without root, a directory of root's is another's.
    let mut other = "/usr".into();
    if rustix::process::geteuid().is_root() {
        other = sandbox.file("other");
        std::fs::create_dir(&other).unwrap();
        std::os::unix::fs::chown(&other, Some(65_534), None).unwrap();
    }
    check(&at(&other), "runtime-dir", "problem", "belongs to user ", "PAIRMASK_RUNTIME_DIR");
    assert!(is_ok(&at(&sandbox.file("new")), "runtime-dir"), "a daemon makes it");
}

#[test]
fn limits_of_the_process_are_named() {
    let sandbox = Sandbox::new();
    let finished = in_shell(&sandbox, "ulimit -n 256;");
    check(&finished, "open-files", "problem", "may have 256", "--max-clients 8");
    let finished = in_shell(&sandbox, "ulimit -v 3000000;");
    check(&finished, "address-space", "warning", "2.9 GiB of address space", "ulimit -v");
    let finished = in_shell(&sandbox, "ulimit -n 1024; PAIRMASK_MAX_CLIENTS=50");
    assert!(is_ok(&finished, "open-files"), "{finished:?}");
    check(
        &doctor(&sandbox, "", &[("PAIRMASK_MAX_MEMORY", "900T")]),
        "memory",
        "problem",
        "may take 921600.0 GiB",
        "--max-memory",
    );
}

#[test]
fn a_small_or_full_shm_is_named() {
    let sandbox = Sandbox::new();
    let with = |options: &str, fill: &str| {
        let line = format!("mount -t tmpfs -o {options} tmpfs /dev/shm && {fill}");
        let inner = format!("{line} {PAIRMASKD} doctor --json");
        in_shell(
            &sandbox,
            &format!("exec unshare --user --map-root-user --mount bash -c '{inner}';"),
        )
    };
    check(&with("size=32m", ""), "shared-memory", "warning", "small: 32.0 MiB", "--shm-size");
    let fill = "head -c 31M /dev/zero > /dev/shm/filler;";
    check(&with("size=32m", fill), "shared-memory", "problem", "/dev/shm is full", "free space");
    let finished = with("ro", "");
    check(&finished, "shared-memory", "problem", "may not write to /dev/shm", "chmod");
}

#[test]
fn drivers_that_are_not_there_are_named() {
    let sandbox = Sandbox::new();
    let gone = [("PAIRMASK_GPU", "auto"), ("VK_ICD_FILENAMES", "/nothing.json")];
    let finished = doctor(&sandbox, "", &gone);
    let cause = "VK_ICD_FILENAMES names /nothing.json";
    check(&finished, "vulkan", "warning", cause, "unset VK_ICD_FILENAMES");
    let finished = doctor(&sandbox, "--gpu 99", &[]);
    check(&finished, "gpu", "problem", "no GPU fits '99'", "pairmaskd gpus");
    let finished = doctor(&sandbox, "--gpu software", &[]);
    assert!(is_ok(&finished, "gpu"), "{finished:?}");
    assert!(entries(&finished, "gpu")[0]["seen"].as_str().unwrap().contains("software"));
}

#[test]
fn what_a_killed_daemon_left_is_named_and_stays() {
    let sandbox = Sandbox::new();
    drop(Serving::start(&sandbox, "", "default"));
    eventually("the worker ends", || sandbox.processes().is_empty().then_some(()));
    let before = sandbox.entries();
    assert!(before.contains("default.socket"), "{before:?}");
    let finished = doctor(&sandbox, "", &[]);
    check(&finished, "left-files", "warning", "that were killed left", "pairmaskd clean");
    // Other tests serve the default instance in other directories.
    check(&finished, "daemon", "warning", "no daemon serves 'default'", "");
    assert_eq!(sandbox.entries(), before);
}

#[test]
fn a_daemon_in_another_directory_is_found() {
    let (sandbox, other) = (Sandbox::new(), Sandbox::new());
    // Other tests serve the default one.
    let name = format!("elsewhere-{}", std::process::id());
    let serving = Serving::start(&other, &format!("--instance {name}"), &name);
    let finished = doctor(&sandbox, &format!("--instance {name}"), &[]);
    let there = other.path().display();
    check(
        &finished,
        "daemon",
        "warning",
        &format!("one of yours does in {there}"),
        &format!("PAIRMASK_RUNTIME_DIR={there}"),
    );
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
}

#[test]
fn a_forced_instruction_set_is_named() {
    let sandbox = Sandbox::new();
    let finished = doctor(&sandbox, "", &[("PAIRMASK_ISA", "portable")]);
    if pairmask_core::engine::Isa::best() == pairmask_core::engine::Isa::Portable {
        assert!(is_ok(&finished, "instruction-set"));
    } else {
        let cause = "engines are held to portable";
        check(&finished, "instruction-set", "warning", cause, "PAIRMASK_ISA");
    }
}

#[test]
fn a_bundle_has_what_a_report_needs_and_nothing_else_of_the_user() {
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "", "default");
    let home = sandbox.path().to_str().unwrap();
    let variables = [("SECRET_TOKEN", "hunter2"), ("HOME", home), ("PAIRMASK_SPIN_US", "70")];
    let finished = run_with(&sandbox, "doctor --bundle bug.txt", &variables);
    let bundle = std::fs::read_to_string(sandbox.file("bug.txt")).unwrap();
    for part in [
        "## pairmaskd\n\n0.",
        "commit ",
        "## machine",
        "cores; ",
        "## doctor",
        "0 problems",
        "## status",
        "\"state\": \"alive\"",
        "## environment",
        "PAIRMASK_RUNTIME_DIR=~",
        "PAIRMASK_SPIN_US=70",
        "## /proc/meminfo",
        "MemTotal:",
    ] {
        assert!(bundle.contains(part), "{part}: {bundle}");
    }
    assert!(!bundle.contains("hunter2") && !bundle.contains(home), "{bundle}");
    assert!(finished.stdout.contains("ok       daemon"), "{finished:?}");

    let piped = run_with(&sandbox, "doctor --bundle -", &variables);
    assert!(piped.stdout.starts_with("## pairmaskd"), "{piped:?}");
    assert_eq!(piped.stdout.matches("ok       daemon").count(), 1, "once");
    let both = sandbox.run_line("doctor --bundle - --json");
    assert!(both.error(2).contains("name a file for one of them"), "{both:?}");
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
}
