//! Mistakes of newcomers: each is one line on stderr that says what to do, without words of Rust.

use std::fs::{File, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use pairmask_core::Aabb;
use pairmask_tests::stress_scenes;

use crate::support::{Finished, PAIRMASKD, Sandbox, finish, full, run_with};

const JARGON: &str = "number would be zero|non-zero type|nonzero|invalid digit|target type|cannot parse|\
                      not in 0..|os error|stream did not contain|expected a string|Os {|::";

fn check(finished: &Finished, code: i32, expected: &str, what: &dyn std::fmt::Debug) {
    let line = finished.error(code);
    assert!(line.contains(expected), "{what:?}: {line}");
    for jargon in JARGON.split('|') {
        assert!(!line.contains(jargon), "{what:?}: {line}");
    }
    assert_eq!(finished.stdout, "", "{what:?}");
}

fn scene() -> Vec<Aabb> {
    stress_scenes::named("uniform").boxes(70, 1)
}

#[test]
fn a_wrong_command_line_is_reported_in_one_line() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    for (line, expected) in [
        ("", "a command is missing, one of serve, cull"),
        ("sing", "there is no command 'sing'"),
        ("cull", "<FILE> is missing: see `pairmaskd cull --help`"),
        ("cull x --engine fast", "'fast' for --engine"),
        ("cull x --shape cones", "'cones' for --shape: choose one of boxes, spheres"),
        ("cull x --threads 0", "'0' for --threads: must be at least 1"),
        ("cull x --threads -1", "must be at least 1"),
        ("cull x --threads many", "must be a whole number"),
        ("cull x --threads 99999999999999999999", "must be at most"),
        ("cull x --frob", "'--frob' is not known here"),
        ("status --confi x", "'--confi' is not known here, did you mean --config?"),
        ("cull x --threads", "--threads needs a value"),
        ("cull x --json --json", "--json is given more than once"),
        ("cull x --json=3", "--json takes no value like '3'"),
        ("explain x -1 2", "'-1' for <I>: must be at least 0"),
        ("--instance cull bench latency --n x", "see `pairmaskd bench latency --help`"),
        ("serve --instance A+B", "'A+B' for --instance"),
        ("demo --seconds 0", "must be at least 1"),
        ("cull x y", "'y' is not known here"),
        ("cull x --precision margin=nan", "margin=X with X >= 0"),
        ("cull boxes.f32 --pairs - --json", "name a file for one of them"),
        ("cull boxes.f32 --pairs - --mask -", "name a file for one of them"),
        ("cull boxes.f32 --pairs p --mask p", "name the same file"),
        ("scene uniform 5000000000 o", "must be at most 4294967295"),
        ("scene uniform -1 o", "must be at least 0"),
        ("scene nowhere 1 o", "choose one of uniform, "),
        ("explain boxes.f32 x 1", "'x' for <I>: must be a whole number"),
        ("bench latency --n 1 --scene x", "--n and --scene exclude each other"),
        ("bench latency --wait patiently", "choose one of spin, event, serve"),
        ("bench", "a command is missing, one of latency"),
        ("bench accuracy", "no command 'accuracy', but latency: see `pairmaskd bench --help`"),
        ("bench latency --frames 0", "must be at least 1"),
        ("bench latency --n 1e6", "must be a whole number in digits alone"),
        ("bench latency --pin --backend in-process", "leave it out"),
        ("serve --max-clients 70000", "must be at most 65535"),
        ("serve --audit 1/0", "1/1000"),
        ("demo --boxes 0", "must be at least 1"),
        ("demo --boxes 20001", "--boxes must be at most 20000"),
        ("cull x --input-format png", "choose one of raw, text, csv, npy"),
    ] {
        check(&sandbox.run_line(line), 2, expected, &line);
    }
}

#[test]
fn a_wrong_variable_is_named_and_an_empty_one_is_none() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    let run = |name, value| run_with(&sandbox, "cull boxes.f32 --json", &[(name, value)]);
    for (name, value, expected) in [
        ("PAIRMASK_THREADS", "0", "'0' in PAIRMASK_THREADS: must be at least 1"),
        ("PAIRMASK_ENGINE", "fast", "'fast' in PAIRMASK_ENGINE"),
        ("PAIRMASK_CONFIG", "absent", "configuration absent: there is no such file"),
    ] {
        check(&run(name, value), 2, expected, &(name, value));
    }
    for name in ["PAIRMASK_INSTANCE", "PAIRMASK_THREADS", "PAIRMASK_BACKEND", "PAIRMASK_GPU"] {
        assert_eq!(run(name, "").json()["boxes"], 70, "{name}");
    }
}

#[test]
fn files_that_cannot_be_used_say_why_and_what_to_do() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    std::fs::create_dir(sandbox.file("dir")).unwrap();
    for (line, expected) in [
        ("cull absent", "absent: there is no such file: check its name"),
        ("cull dir", "dir: it is a directory: name a file"),
        ("explain absent 0 1", "absent: there is no such file"),
        ("bench latency --scene absent", "absent: there is no such file"),
        ("cull boxes.f32 --backend in-process --pairs dir", "dir: it is a directory"),
        ("cull boxes.f32 --backend in-process --pairs no/p", "no/p: there is no such directory"),
        ("cull boxes.f32 --backend in-process --pairs /dev/full", "the disk is full: free space"),
        ("cull boxes.f32 --backend in-process --mask /dev/full", "the disk is full: free space"),
        ("scene uniform 9 no/such", "no/such: there is no such directory: create it"),
        ("scene uniform 9 /dev/full", "the disk is full"),
    ] {
        // A busy machine would be warned of too.
        let finished = run_with(&sandbox, line, &[("PAIRMASK_LOG", "error")]);
        check(&finished, 1, expected, &line);
    }
}

/// A copy of the program that every user may run.
fn program_of_all(sandbox: &Sandbox) -> PathBuf {
    std::fs::set_permissions(sandbox.path(), Permissions::from_mode(0o755)).unwrap();
    // By another process: one that is written here may not be executed while a test forks.
    let program = sandbox.file("pairmaskd");
    let copied = Command::new("cp").args([PAIRMASKD.as_ref(), program.as_path()]).status().unwrap();
    assert!(copied.success());
    program
}

/// A line for a program, without an environment.
fn bare(program: &Path, line: &str) -> Command {
    let mut command = Command::new(program);
    command.args(line.split_whitespace()).env_clear();
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Another user than the tests' own, root.
const NOBODY: u32 = 65_534;

#[test]
fn what_belongs_to_others_says_what_to_do() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    let own = sandbox.file("pairmask");
    std::fs::create_dir(&own).unwrap();
    std::fs::write(own.join("config.toml"), "threads = 1\n").unwrap();
    let lock = |path: &Path, mode| std::fs::set_permissions(path, Permissions::from_mode(mode));
    let program = program_of_all(&sandbox);
    lock(&sandbox.file("boxes.f32"), 0).unwrap();
    lock(&own.join("config.toml"), 0).unwrap();
    // Root may read files without any read permission.
    let may_read_all = File::open(sandbox.file("boxes.f32")).is_ok();
    let run = |line: &str| {
        let mut command = bare(&program, line);
        command.current_dir(sandbox.path()).env("PAIRMASK_RUNTIME_DIR", sandbox.path());
        if may_read_all {
            command.uid(NOBODY);
        }
        finish(command.env("XDG_CONFIG_HOME", sandbox.path()).spawn().unwrap())
    };
    for (line, code, expected) in [
        ("status", 2, "config.toml: you may not read it: change its permissions"),
        ("status", 2, "--config, /dev/null for none"),
        ("explain boxes.f32 0 1", 1, "boxes.f32: you may not read it"),
        ("cull boxes.f32 --config /dev/null", 1, "boxes.f32: you may not read it"),
    ] {
        check(&run(line), code, expected, &line);
    }
    if may_read_all {
        check(&run("scene uniform 9 new"), 1, "new: you may not write there", &"new");
    }
}

#[test]
fn a_wrong_configuration_is_reported_with_its_line() {
    let sandbox = Sandbox::new();
    for (text, expected) in [
        ("threads = 0", "config.toml, line 1 (threads = 0): must be at least 1"),
        ("\nthreads = 'x'", "line 2 (threads = 'x'): must be a whole number without quotes"),
        ("max-clients = 70000", "must be at most 65535"),
        ("spin-us = -1", "must be at least 0"),
        ("engine = 3", "must be text in quotes"),
        ("instance = 'A B'", "A B"),
        ("engine = 'fast'", "choose one of auto, "),
        ("motor = 1", "unknown key `motor`"),
        ("[[[", "line 1 ([[[)"),
        ("gpu = true", "must be text in quotes"),
    ] {
        std::fs::write(sandbox.file("config.toml"), text).unwrap();
        check(&sandbox.run_line("status --config config.toml"), 2, expected, &text);
    }
    std::fs::write(sandbox.file("config.toml"), [0xff, 0xfe]).unwrap();
    check(&sandbox.run_line("status --config config.toml"), 2, "it is no text", &"bytes");
    check(&sandbox.run_line("status --config ."), 2, ".: it is a directory", &"directory");
    // A command that uses no setting does not fail by a wrong one.
    let finished = run_with(&sandbox, "scene uniform 9 o", &[("PAIRMASK_CONFIG", "config.toml")]);
    assert_eq!(finished.code, Some(0));
}

#[test]
fn a_process_that_failed_is_reported_of_once() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    for line in ["serve --gpu 99", "cull boxes.f32 --spawn --gpu 99", "demo --seconds 1 --gpu 99"] {
        // It serves on cores until it knows, and says that it does.
        let finished = run_with(&sandbox, line, &[("PAIRMASK_LOG", "warn")]);
        assert!(finished.error(1).contains("no GPU fits '99'"), "{finished:?}");
    }
}

#[test]
fn stderr_that_takes_nothing_is_no_crash() {
    let sandbox = Sandbox::new();
    for (line, code) in [("cull absent", 1), ("cull absent --frob", 2)] {
        let status = sandbox.line(line).stderr(full()).status().unwrap();
        assert_eq!(status.code(), Some(code), "{line}");
    }
}

#[test]
fn a_reader_that_has_ended_is_no_failure_and_output_without_room_is_one() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    for line in [
        "--help",
        "--version",
        "explain boxes.f32 0 1",
        "cull boxes.f32 --backend in-process",
        "cull boxes.f32 --backend in-process --json",
        "cull boxes.f32 --backend in-process --pairs -",
        "cull boxes.f32 --backend in-process --mask -",
        "scene uniform 1000 -",
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = sandbox.line(line);
        let finished = command.stdout(writer).stderr(Stdio::piped()).output().unwrap();
        let stderr = String::from_utf8_lossy(&finished.stderr);
        assert_eq!(finished.status.code(), Some(0), "{line}: {stderr}");
        assert!(!stderr.contains("Broken pipe") && !stderr.contains("panicked"), "{stderr}");
        let output = sandbox.line(line).stdout(full()).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        let (code, stdout) = (output.status.code(), String::new());
        let finished = Finished { name: "pairmaskd", code, stdout, stderr };
        check(&finished, 1, "standard output: the disk is full: free space", &line);
    }
}

#[test]
fn a_file_that_is_no_scene_is_warned_of() {
    let sandbox = Sandbox::new();
    let in_process = |line: &str| sandbox.run_line(&format!("{line} --backend in-process"));
    let cull = |more: &str| in_process(&format!("cull boxes.f32 {more}"));
    sandbox.boxes(&scene());
    let fine = cull("--json");
    assert_eq!((fine.json()["warnings"].as_array().unwrap().len(), fine.stderr.as_str()), (0, ""));

    sandbox.boxes(&[Aabb::EMPTY; 20]);
    let empty = cull("--json");
    assert!(empty.stderr.contains("no box overlaps anything"), "{empty:?}");
    assert!(empty.json()["warnings"][0].as_str().unwrap().contains("empty"), "{empty:?}");
    let latency = in_process("bench latency --scene boxes.f32 --frames 2");
    assert!(latency.stderr.contains("no box overlaps anything"), "{latency:?}");

    let spheres: Vec<[f32; 4]> =
        (0..240u8).map(|i| [f32::from(i), 9.0, f32::from(i % 50), 0.5]).collect();
    std::fs::write(sandbox.file("boxes.f32"), bytemuck::cast_slice(&spheres)).unwrap();
    let as_boxes = cull("--json");
    assert!(as_boxes.stderr.contains("try --shape spheres"), "{as_boxes:?}");
    assert_eq!(as_boxes.json()["warnings"].as_array().unwrap().len(), 1);
    assert_eq!(cull("--shape spheres").stderr, "");
    sandbox.boxes(&stress_scenes::named("uniform").boxes(240, 1));
    let as_spheres = cull("--shape spheres");
    assert!(as_spheres.stderr.contains("without --shape spheres"), "{as_spheres:?}");
}

#[test]
fn latency_is_measured_where_it_says() {
    let sandbox = Sandbox::new();
    let latency = |sandbox_of_daemon: &str| {
        let line = "bench latency --n 50 --frames 3 --warm-up 1 --json";
        sandbox.run_line(&format!("{line} --backend {sandbox_of_daemon}")).json()
    };
    for (backend, answered) in
        [("daemon", "daemon"), ("in-process", "in-process"), ("auto", "in-process")]
    {
        assert_eq!(latency(backend)["rows"][0]["backend"], answered, "--backend {backend}");
    }
    let daemon = crate::support::daemon();
    let report = latency(&format!("auto --runtime-dir {}", daemon.dir().path().display()));
    assert_eq!(report["rows"][0]["backend"], "daemon", "auto takes the daemon that serves");
}

/// Each would be read without end.
#[test]
fn a_device_without_an_end_is_refused() {
    let sandbox = Sandbox::new();
    for device in ["/dev/full", "/dev/zero"] {
        let finished = sandbox.run_line(&format!("cull {device} --backend in-process"));
        check(&finished, 1, "a device without an end: name a file", &device);
        let mut command = sandbox.line("cull - --backend in-process");
        let child = command.stdin(File::open(device).unwrap()).spawn().unwrap();
        check(&finish(child), 1, "a device without an end: name a file", &device);
    }
    let finished = sandbox.run_line("cull /dev/null --backend in-process --json");
    assert_eq!(finished.json()["boxes"], 0);
}

/// As after `sudo -u`, or in a service of another user.
#[test]
fn the_home_of_another_user_is_named() {
    if !rustix::process::geteuid().is_root() {
        // Without root the test cannot act as a second user, and root's home stands for another's.
        return;
    }
    let sandbox = Sandbox::new();
    let program = program_of_all(&sandbox);
    let home = sandbox.file("home");
    std::fs::create_dir(&home).unwrap();
    std::fs::set_permissions(&home, Permissions::from_mode(0o700)).unwrap();
    for variable in ["HOME", "XDG_CONFIG_HOME"] {
        let mut command = bare(&program, "status");
        command.env(variable, &home).env("PAIRMASK_RUNTIME_DIR", "/tmp").uid(NOBODY).gid(NOBODY);
        let finished = finish(command.spawn().unwrap());
        let expected = format!("{variable} is {}, which belongs to user 0", home.display());
        check(&finished, 2, &expected, &variable);
    }
}
