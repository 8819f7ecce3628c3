//! `bench accuracy`: its rows, its verdicts and its files.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::support::{Finished, Place, keys};

const FIELDS: [&str; 18] = [
    "scene",
    "n",
    "mode",
    "margin",
    "backend",
    "engine",
    "served_by_engine",
    "frames",
    "requests",
    "times",
    "bytes_up",
    "bytes_down",
    "checked_frames",
    "true_pairs",
    "missed",
    "extra",
    "extra_ratio",
    "memory_bytes",
];

fn run(place: &Place, more: &[&str]) -> Finished {
    let mut arguments =
        vec!["bench", "accuracy", "--frames", "8", "--warm-up", "1", "--checked", "2"];
    arguments.extend(more);
    place.run(&arguments)
}

fn check_rows(report: &Value, expected: usize, backend: &str) {
    assert_eq!(keys(report), BTreeSet::from(["machine", "seed", "rows"]));
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), expected);
    for row in rows {
        assert_eq!(keys(row), BTreeSet::from(FIELDS));
        assert_eq!((&row["missed"], &row["checked_frames"]), (&0.into(), &2.into()), "{row}");
        assert_eq!((&row["backend"], &row["frames"]), (&backend.into(), &8.into()), "{row}");
        assert!(row["true_pairs"].as_u64().unwrap() > 0 && row["memory_bytes"].as_u64() > Some(0));
        assert_eq!(row["times"].as_object().unwrap().len(), 9, "{row}");
        let is_exact = row["mode"] == "exact";
        assert!(!is_exact || row["extra"] == 0, "{row}");
        let margin = if row["mode"] == "margin" { 0.1.into() } else { Value::Null };
        assert_eq!(row["margin"], margin, "{row}");
    }
}

#[test]
fn rows_for_every_mode_scene_and_engine() {
    let place = Place::new();
    let scenes = ["--scene", "uniform,pile", "--n", "345", "--json"];
    check_rows(&run(&place, &scenes).json(), 2 * 5, "daemon");
    place.assert_clean(&[]);
    let engines =
        ["--backend", "in-process", "--precision", "q8", "--engines", "cpu-brute,cpu-sap,cpu-grid"];
    check_rows(&run(&place, &[&scenes[..], &engines[..]].concat()).json(), 2 * 3, "in-process");
}

#[test]
fn verdicts_and_files() {
    let place = Place::new();
    let base = ["--scene", "uniform", "--n", "345", "--backend", "in-process", "--precision", "q8"];
    let with = |more: &[&str]| run(&place, &[&base[..], more].concat());
    let kept = with(&["--assert", "missed=0,p99<600s", "--out", "before"]);
    assert_eq!(kept.code, Some(0), "{kept:?}");
    assert!(kept.stdout.contains("q8") && kept.stdout.contains("p99 ms"), "{kept:?}");
    let broken = with(&["--assert", "missed=0,extra=0"]);
    assert_eq!(broken.code, Some(1), "{broken:?}");
    assert!(broken.stdout.contains("not kept: uniform 345 q8 in-process auto: extra=0"));
    assert!(broken.stderr.contains("1 limits are not kept"), "{broken:?}");
    assert_eq!(with(&["--assert", "quality=1"]).code, Some(2));

    let csv = std::fs::read_to_string(place.file("before").join("accuracy.csv")).unwrap();
    assert_eq!(csv.lines().count(), 2, "{csv}");
    let page = std::fs::read_to_string(place.file("before").join("report.html")).unwrap();
    assert!(page.contains("No pair was missed") && page.trim_end().ends_with("</html>"));
    let path = place.file("before").join("accuracy.json");
    let mut before: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    check_rows(&before, 1, "in-process");
    before["rows"][0]["times"]["total_ns"]["p50"] = 1.into();
    before["rows"][0]["extra_ratio"] = 0.into();
    std::fs::write(&path, before.to_string()).unwrap();
    let worse = with(&["--compare", "before/accuracy.json"]);
    assert_eq!(worse.code, Some(0), "{worse:?}");
    for part in ["worse: uniform 345 q8", "p50", "extra pairs, were 0.000 %"] {
        assert!(worse.stdout.contains(part), "{worse:?}");
    }
    let other = run(&place, &["--n", "10", "--compare", "before/accuracy.json"]);
    assert!(other.error(1).contains("no row in common"), "{other:?}");
    assert!(with(&["--compare", "absent.json"]).error(1).contains("absent.json"));
}
