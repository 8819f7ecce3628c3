//! Flag before environment before file before default; and what the command line refuses.

use pairmask_core::Aabb;
use pairmask_core::engine::Isa;

use crate::support::{Finished, Place, finish};

fn backend_of(finished: &Finished) -> String {
    finished.json()["backend"].as_str().unwrap().to_owned()
}

#[test]
fn flag_then_environment_then_file_then_default() {
    let place = Place::new();
    place.boxes(&[Aabb::EMPTY; 3]);
    let cull = ["cull", "boxes.f32", "--json"];
    let encoding = |finished: Finished| finished.json()["encoding"].as_str().unwrap().to_owned();
    // No daemon serves: the default backend, auto, falls back.
    assert_eq!(backend_of(&place.run(&cull)), "in-process");
    std::fs::create_dir(place.file("pairmask")).unwrap();
    let file = place.file("pairmask/config.toml");
    std::fs::write(&file, "backend = 'in-process'\nencoding = 'sparse'\n").unwrap();
    assert_eq!(encoding(place.run(&cull)), "sparse");
    let mut command = place.command(&cull);
    command.env("PAIRMASK_ENCODING", "dense");
    assert_eq!(encoding(finish(command.spawn().unwrap())), "dense");
    let mut command = place.command(&cull);
    command.env("PAIRMASK_ENCODING", "dense").args(["--encoding", "sparse"]);
    assert_eq!(encoding(finish(command.spawn().unwrap())), "sparse");
    std::fs::write(place.file("other.toml"), "encoding = 'dense'\n").unwrap();
    let named = ["cull", "boxes.f32", "--json", "--config", "other.toml"];
    assert_eq!(encoding(place.run(&named)), "dense");
}

#[test]
fn an_instruction_set_is_forced_by_flag_environment_or_file() {
    let place = Place::new();
    place.boxes(&[Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 3]);
    let cull = ["cull", "boxes.f32", "--json", "--explain", "--backend", "in-process"];
    let constants = |finished: Finished| {
        assert_eq!(finished.json()["pairs"], 3);
        finished.json()["explain"]["calibration"].as_str().unwrap().to_owned()
    };
    let portable = [&cull[..], &["--isa", "portable"]].concat();
    assert_eq!(constants(place.run(&portable)), "built in for portable");
    let mut command = place.command(&cull);
    command.env("PAIRMASK_ISA", "portable");
    assert_eq!(constants(finish(command.spawn().unwrap())), "built in for portable");
    std::fs::write(place.file("own.toml"), "isa = 'portable'\n").unwrap();
    let configured = [&cull[..], &["--config", "own.toml"]].concat();
    assert_eq!(constants(place.run(&configured)), "built in for portable");
    // By a daemon of its own, which is told so.
    let spawn = ["cull", "boxes.f32", "--json", "--spawn", "--gpu", "none", "--isa", "portable"];
    assert_eq!(place.run(&spawn).json()["pairs"], 3);

    for missing in Isa::ALL.into_iter().filter(|isa| !isa.is_available()) {
        let finished = place.run(&["cull", "boxes.f32", "--isa", missing.as_str()]);
        let error = finished.error(2);
        assert!(error.contains("this processor lacks"), "{error}");
    }
    let finished = place.run(&["cull", "boxes.f32", "--isa", "fast"]);
    let error = finished.error(2);
    assert!(error.contains("portable"), "the names are listed: {error}");
}

#[test]
fn help_has_examples_and_version_names_wire_and_commit() {
    let place = Place::new();
    for command in [&["--help"][..], &["serve", "--help"], &["cull", "--help"], &["demo", "--help"]]
    {
        let finished = place.run(command);
        assert_eq!(finished.code, Some(0));
        assert!(finished.stdout.contains("Examples:"), "{command:?}");
        assert!(!finished.stdout.contains("worker"), "hidden flags stay hidden");
    }
    let version = place.run(&["--version"]).stdout;
    assert!(version.contains("wire 1.") && version.contains("commit "), "{version}");
}
