//! `stress`: right engines pass, a broken one is caught and reported.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::support::{Place, keys};

#[test]
fn right_engines_pass() {
    let place = Place::new();
    let report = place.run(&["stress", "--seconds", "1", "--seed", "3", "--json"]).json();
    let fields = [
        "seed",
        "subjects",
        "cases",
        "answers",
        "skipped",
        "missed",
        "extra",
        "elapsed_ns",
        "failures",
    ];
    assert_eq!(keys(&report), BTreeSet::from(fields));
    assert_eq!(report["skipped"], Value::Array(vec![]));
    assert!(report["cases"].as_u64().unwrap() > 0);
    assert_eq!((&report["missed"], &report["extra"]), (&0.into(), &0.into()));
    assert_eq!(report["failures"], Value::Array(vec![]));
    let subjects = report["subjects"].as_array().unwrap();
    for engine in ["cpu-brute", "cpu-sap", "cpu-grid", "spheres"] {
        assert!(subjects.iter().any(|s| s.as_str().unwrap().starts_with(engine)), "{subjects:?}");
    }
}

#[test]
fn a_broken_engine_is_caught_within_seconds_and_replayed() {
    let place = Place::new();
    let arguments =
        ["stress", "--seconds", "60", "--engine", "cpu-sap", "--mode", "exact", "--break-engine"];
    let finished = place.run(&[&arguments[..], &["--json"]].concat());
    assert_eq!(finished.code, Some(1), "{finished:?}");
    let report: Value = serde_json::from_str(&finished.stdout).unwrap();
    // Ten wrong answers end a run long before its time.
    assert!(report["elapsed_ns"].as_u64().unwrap() < 55_000_000_000, "{report}");
    assert!(report["missed"].as_u64().unwrap() > 0 && report["extra"] == 0, "{report}");
    let failure = &report["failures"][0];
    let fields = [
        "case", "subject", "mode", "replay", "boxes", "scene", "flags", "what", "missed", "extra",
        "pair", "explain",
    ];
    assert_eq!(keys(failure), BTreeSet::from(fields));
    assert_eq!(failure["explain"]["overlaps"], true);

    let case = failure["case"].to_string();
    let replay = format!("pairmask-lab stress --case {case} --engine cpu-sap --mode exact");
    assert_eq!(failure["replay"], replay);
    let again =
        ["stress", "--case", &case, "--engine", "cpu-sap", "--mode", "exact", "--break-engine"];
    let text = place.run(&again);
    assert_eq!(text.code, Some(1), "{text:?}");
    assert!(text.stdout.contains("is missing") && text.stdout.contains("IN the mask"), "{text:?}");
    assert_eq!(place.run(&again[..7]).code, Some(0), "the engine as it is answers the case");
}

#[test]
fn a_mode_that_rounds_inward_is_caught_within_seconds_and_replayed() {
    let place = Place::new();
    let arguments =
        ["stress", "--seconds", "60", "--mode", "q8,f16,f64", "--break-engine=inward", "--json"];
    let finished = place.run(&arguments);
    assert_eq!(finished.code, Some(1), "{finished:?}");
    let report: Value = serde_json::from_str(&finished.stdout).unwrap();
    assert!(report["elapsed_ns"].as_u64().unwrap() < 55_000_000_000, "{report}");
    assert!(report["missed"].as_u64().unwrap() > 0 && report["extra"] == 0, "{report}");
    let failure = &report["failures"][0];
    let mode = failure["mode"].as_str().unwrap();
    assert!(["q8", "f16", "f64"].contains(&mode), "{failure}");
    assert_eq!(failure["explain"]["mode"], mode);

    // The command that is printed, word by word.
    let replay: Vec<&str> = failure["replay"].as_str().unwrap().split(' ').skip(1).collect();
    let text = place.run(&[&replay[..], &["--break-engine=inward"]].concat());
    assert_eq!(text.code, Some(1), "{text:?}");
    assert!(text.stdout.contains(&format!("mode {mode}")), "{text:?}");
    assert_eq!(place.run(&replay).code, Some(0), "the mode as it is answers the case");
}

#[test]
fn an_engine_that_is_not_there_is_an_error() {
    let place = Place::new();
    assert_eq!(place.run(&["stress", "--engine", "nobody"]).code, Some(2));
    assert_eq!(place.run(&["stress", "--mode", "q17"]).code, Some(2));
    let without_subject = place.run(&["stress", "--engine", "spheres", "--mode", "q16"]);
    assert!(without_subject.error(1).contains("nothing to run"), "{without_subject:?}");
    for engine in ["gpu-brute", "gpu-grid"] {
        place.run(&["stress", "--engine", engine, "--gpu", "none"]).error(1);
    }
}
