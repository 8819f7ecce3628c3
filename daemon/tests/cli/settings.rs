//! Flag before environment before file before default; and what the command line refuses.

use pairmask_core::Aabb;
use pairmask_core::engine::Isa;
use pairmask_transport::RuntimeDir;
use rustix::process::Signal;

use crate::support::{Sandbox, Serving, run_with};

#[test]
fn flag_then_environment_then_file_then_default() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&[Aabb::EMPTY; 3]);
    let encoding = |more: &str, variables: &[(&str, &str)]| {
        let finished = run_with(&sandbox, &format!("cull boxes.f32 --json {more}"), variables);
        finished.json()["encoding"].as_str().unwrap().to_owned()
    };
    // No daemon serves: the default backend, auto, falls back.
    assert_eq!(sandbox.run_line("cull boxes.f32 --json").json()["backend"], "in-process");
    std::fs::create_dir(sandbox.file("pairmask")).unwrap();
    let file = sandbox.file("pairmask/config.toml");
    std::fs::write(&file, "backend = 'in-process'\nencoding = 'sparse'\n").unwrap();
    let variable = [("PAIRMASK_ENCODING", "dense")];
    assert_eq!(encoding("", &[]), "sparse");
    assert_eq!(encoding("", &variable), "dense");
    assert_eq!(encoding("--encoding sparse", &variable), "sparse");
    std::fs::write(sandbox.file("other.toml"), "encoding = 'dense'\n").unwrap();
    assert_eq!(encoding("--config other.toml", &[]), "dense");
}

#[test]
fn an_instruction_set_is_forced_by_flag_environment_or_file() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&[Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 3]);
    let constants = |more: &str, variables: &[(&str, &str)]| {
        let line = format!("cull boxes.f32 --json --explain --backend in-process {more}");
        let report = run_with(&sandbox, &line, variables).json();
        assert_eq!(report["pairs"], 3);
        assert_eq!(report["explain"]["calibration"], "built in for portable");
    };
    constants("--isa portable", &[]);
    constants("", &[("PAIRMASK_ISA", "portable")]);
    std::fs::write(sandbox.file("own.toml"), "isa = 'portable'\n").unwrap();
    constants("--config own.toml", &[]);
    // By a daemon of its own, which is set up so.
    let spawned = sandbox.run_line("cull boxes.f32 --json --spawn --gpu none --isa portable");
    assert_eq!(spawned.json()["pairs"], 3);

    for missing in Isa::ALL.into_iter().filter(|isa| !isa.is_available()) {
        let finished = sandbox.run_line(&format!("cull boxes.f32 --isa {}", missing.as_str()));
        assert!(finished.error(2).contains("this processor lacks"), "{finished:?}");
    }
    let finished = sandbox.run_line("cull boxes.f32 --isa fast");
    assert!(finished.error(2).contains("portable"), "the names are listed: {finished:?}");
}

/// The worker's log too, which the supervisor starts.
#[test]
fn how_much_is_logged_is_a_flag_before_a_variable() {
    let logged = |line: &str, variable: &str| {
        let sandbox = Sandbox::new();
        let mut command = sandbox.line(line);
        let child = command.env("PAIRMASK_LOG", variable).spawn().unwrap();
        let serving = Serving::of(child, RuntimeDir::at(sandbox.path()), "default");
        drop(serving.session());
        serving.stop(Signal::TERM).stderr
    };
    assert_eq!(logged("serve -q", "debug"), "");
    assert_eq!(logged("serve", "error"), "");
    let more = logged("--verbose serve", "error");
    assert!(more.contains("serving 'default'"), "{more}");
    let both = Sandbox::new().run_line("status -q -v");
    assert!(both.error(2).contains("exclude each other"), "{both:?}");
}

#[test]
fn help_has_examples_and_version_names_wire_and_commit() {
    let sandbox = Sandbox::new();
    for command in ["--help", "serve --help", "cull --help", "demo --help"] {
        let finished = sandbox.run_line(command);
        assert_eq!(finished.code, Some(0));
        assert!(finished.stdout.contains("Examples:"), "{command:?}");
        assert!(!finished.stdout.contains("--worker"), "hidden flags stay hidden");
    }
    let version = sandbox.run_line("--version").stdout;
    assert!(version.contains("wire 1.") && version.contains("commit "), "{version}");
}
