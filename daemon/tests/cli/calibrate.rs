//! `calibrate`: measured constants are kept, used, and ignored where they cannot be used.

use std::collections::BTreeSet;
use std::path::PathBuf;

use pairmask_core::EngineName;
use pairmask_tests::stress_scenes;

use crate::support::{Finished, Place, finish, keys};

/// The one calibration file of a cache directory.
fn kept(place: &Place) -> PathBuf {
    let files: Vec<_> = std::fs::read_dir(place.file("pairmask"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    assert_eq!(files.len(), 1, "{files:?}");
    files[0].clone()
}

fn run_with_cache(place: &Place, arguments: &[&str]) -> Finished {
    let mut command = place.command(arguments);
    command.env("XDG_CACHE_HOME", place.path());
    finish(command.spawn().unwrap())
}

/// The constants' origin by `cull --explain`, and stderr.
fn used(place: &Place, more: &[&str]) -> (String, String) {
    let mut arguments = vec!["cull", "boxes.f32", "--backend", "in-process", "--explain", "--json"];
    arguments.extend(more);
    let finished = run_with_cache(place, &arguments);
    let text = finished.json()["explain"]["calibration"].as_str().unwrap().to_owned();
    (text, finished.stderr)
}

#[test]
fn constants_are_kept_for_this_machine_and_used() {
    let place = Place::new();
    place.boxes(&stress_scenes::named("uniform").boxes(70, 1));
    assert!(used(&place, &[]).0.starts_with("built in for "));

    let report = run_with_cache(&place, &["calibrate", "--quick", "--json"]).json();
    let fields = [
        "machine",
        "key",
        "file",
        "load_share",
        "ns",
        "threads",
        "visit",
        "rows",
        "median_error",
        "built_in_median_error",
    ];
    assert_eq!(keys(&report), BTreeSet::from(fields));
    assert!(report["ns"].as_object().unwrap().values().all(|ns| ns.as_f64().unwrap() > 0.0));
    assert_eq!(keys(&report["threads"]), EngineName::CPU.map(EngineName::as_str).into());
    assert!(report["rows"].as_u64().unwrap() > 20);

    let file = kept(&place);
    assert_eq!(report["file"], file.to_str().unwrap());
    assert_eq!(used(&place, &[]), (file.to_str().unwrap().to_owned(), String::new()));
    // Flag, then environment, then the file.
    assert!(used(&place, &["--calibration", "built-in"]).0.starts_with("built in for "));
}

#[test]
fn a_file_that_cannot_be_used_is_told_and_ignored() {
    let place = Place::new();
    place.boxes(&stress_scenes::named("uniform").boxes(70, 1));
    let finished = place.run(&["calibrate", "--quick", "--dry-run"]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    let text = finished.stdout;
    for (damaged, named) in [
        (text.replacen("machine = \"", "machine = \"not ", 1), "another machine"),
        (text.replacen("version = 2", "version = 77", 1), "version 77"),
        (text.replacen("[ns]", "[ms]", 1), "no calibration"),
        ("\0\u{7f}".to_owned(), "no calibration"),
    ] {
        std::fs::write(place.file("own.toml"), damaged).unwrap();
        let (origin, stderr) = used(&place, &["--calibration", "own.toml"]);
        assert!(origin.starts_with("built in for "), "{origin}");
        assert!(stderr.contains("own.toml is not used") && stderr.contains(named), "{stderr}");
    }
    std::fs::write(place.file("own.toml"), &text).unwrap();
    assert_eq!(used(&place, &["--calibration", "own.toml"]), ("own.toml".into(), String::new()));
    let (origin, stderr) = used(&place, &["--calibration", "absent.toml"]);
    assert!(origin.starts_with("built in") && stderr.contains("absent.toml"), "{stderr}");
}

#[test]
fn calibration_without_a_place_to_keep_it_is_not_kept() {
    let place = Place::new();
    // A busy machine is a warning, which this test ignores.
    let run = |arguments: &[&str]| {
        finish(place.command(arguments).env("PAIRMASK_LOG", "error").spawn().unwrap())
    };
    let error = run(&["calibrate", "--quick"]);
    assert!(error.error(1).contains("HOME"), "{error:?}");
    std::fs::write(place.file("no.toml"), "").unwrap();
    let error = run(&["calibrate", "--quick", "--out", "no.toml/such", "--json"]);
    assert!(error.error(1).contains("no.toml/such"), "{error:?}");
}
