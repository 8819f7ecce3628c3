//! `bench plan`, `bench threads` and `bench replies`: their JSON, and that figures agree.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::support::{Place, keys};

fn rows(report: &Value) -> &[Value] {
    assert_eq!(keys(&report["machine"]).len(), 7, "{report}");
    report["rows"].as_array().unwrap()
}

#[test]
fn the_plan_is_judged_scene_by_scene() {
    let place = Place::new();
    let arguments = ["bench", "plan", "--scene", "uniform,rods", "--n", "70,600", "--threads", "1"];
    let report = place.run(&[&arguments[..], &["--json"]].concat()).json();
    assert!(report["calibration"].as_str().unwrap().starts_with("built in"), "{report}");
    assert_eq!(rows(&report).len(), 4);
    for row in rows(&report) {
        let ns = |name: &str| row[name].as_u64().unwrap();
        assert_eq!((&row["threads"], &row["engine_threads"]), (&1.into(), &1.into()));
        assert!(ns("planned_ns") >= ns("best_ns") && ns("best_ns") > 0, "{row}");
        let ratio = (ns("planned_ns") + ns("plan_ns")) as f64 / ns("best_ns") as f64;
        assert!((row["ratio"].as_f64().unwrap() - ratio).abs() < 1e-9, "{row}");
    }
    let text = place.run(&arguments).stdout;
    assert!(text.contains("of 4 above 1.3"), "{text}");
}

#[test]
fn speed_ups_stand_beside_the_papers() {
    let place = Place::new();
    let report = place
        .run(&[
            "bench",
            "threads",
            "--scene",
            "cubes,uniform",
            "--n",
            "300",
            "--threads",
            "2",
            "--json",
            "--out",
            "figures",
        ])
        .json();
    let fields = [
        "stage",
        "scene",
        "n",
        "engine",
        "threads",
        "frames",
        "least_ns",
        "median_ns",
        "speed_up",
        "paper_ns",
        "paper_speed_up",
    ];
    // Two scenes, one or two threads: the first stage, and the second with three engines.
    assert_eq!(rows(&report).len(), 2 * 2 * 4);
    for row in rows(&report) {
        assert_eq!(keys(row), BTreeSet::from(fields));
        assert_eq!(row["engine"].is_null(), row["stage"] == "update-aabbs", "{row}");
        assert_eq!(row["paper_ns"].is_null(), row["scene"] == "uniform", "{row}");
        if row["threads"] == 1 {
            assert_eq!(row["speed_up"], 1.0);
        }
    }
    let csv = std::fs::read_to_string(place.file("figures/threads.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + rows(&report).len());
    assert_eq!(csv.lines().next().unwrap().split(',').count(), fields.len());
    assert!(csv.contains("update-aabbs,cubes,300,,2,"), "{csv}");
    let written = std::fs::read_to_string(place.file("figures/threads.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), report);
}

#[test]
fn replies_are_weighed_against_lists_of_pairs() {
    let place = Place::new();
    let report = place.run(&["bench", "replies", "--n", "70,10001", "--json"]).json();
    let of = |scene: &str, n: u64, encoding: &str| {
        let found = rows(&report).iter().filter(move |row| {
            row["scene"] == scene && row["n"] == n && row["encoding"] == encoding
        });
        found.cloned().collect::<Vec<_>>()
    };
    for row in rows(&report) {
        let (bytes, pairs) = (row["mask_bytes"].as_u64().unwrap(), row["pairs"].as_u64().unwrap());
        assert_eq!(row["list_bytes"], 8 * pairs);
        let a_pair = row["bytes_a_pair"].as_f64().unwrap();
        assert!((a_pair * pairs as f64 - bytes as f64).abs() < 1.0, "{row}");
    }
    assert_eq!(of("uniform", 70, "sparse").len(), 3, "every engine");
    assert_eq!(of("uniform", 10_001, "sparse").len(), 1, "the planned one");
    // All of 70 · 69 / 2 pairs overlap: a bit each, in whole words.
    let identical = &of("identical", 70, "dense")[0];
    assert_eq!((&identical["pairs"], &identical["mask_bytes"]), (&2415.into(), &304.into()));
    assert!(of("identical", 10_001, "sparse").is_empty(), "left out: 50 million pairs");
    let text = place.run(&["bench", "replies", "--scene", "pile", "--n", "70"]).stdout;
    assert!(text.contains("bytes/pair") && text.contains("link saves"), "{text}");
}

#[test]
fn forms_of_sparse_masks_are_weighed_and_timed() {
    let place = Place::new();
    let report =
        place.run(&["bench", "replies", "--scene", "uniform,pile", "--n", "70,2000", "--json"]);
    let report = report.json();
    let forms = report["forms"].as_array().unwrap();
    assert_eq!(forms.len(), 2 * 2 * 5);
    let grid = rows(&report).iter().filter(|row| row["engine"] == "cpu-grid");
    for row in grid.filter(|row| row["encoding"] == "sparse") {
        let mut same = forms.iter().filter(|form| {
            form["scene"] == row["scene"] && form["n"] == row["n"] && form["form"] == "sparse"
        });
        let form = same.next().unwrap();
        assert_eq!((&form["bytes"], &form["pairs"]), (&row["mask_bytes"], &row["pairs"]));
    }
    for form in forms {
        let fields = [
            "scene",
            "n",
            "pairs",
            "form",
            "entries",
            "bytes",
            "order_bytes",
            "bytes_a_pair",
            "order_kept_bytes_a_pair",
            "decode_ns",
            "production_decode_ns",
            "decode_ratio",
        ];
        assert_eq!(keys(form), BTreeSet::from(fields));
        let whole = |name: &str| form[name].as_u64().unwrap();
        let ratio = whole("decode_ns") as f64 / whole("production_decode_ns") as f64;
        assert!((form["decode_ratio"].as_f64().unwrap() - ratio).abs() < 1e-9, "{form}");
        let order = if form["form"] == "list" { 0 } else { 4 * whole("n") };
        assert_eq!(whole("order_bytes"), order, "{form}");
    }
    let smallest = report["smallest"].as_array().unwrap();
    assert_eq!(smallest.len(), 2 * 2);
    for row in smallest {
        assert_eq!(row["n"], 2_000);
        let order = |form: &Value| {
            if row["order"] == "kept" { form["order_bytes"].as_u64().unwrap() } else { 0 }
        };
        let of_mask =
            forms.iter().filter(|form| form["scene"] == row["scene"] && form["n"] == 2_000);
        let least = of_mask.map(|form| form["bytes"].as_u64().unwrap() - order(form)).min();
        assert_eq!(row["bytes"].as_u64(), least, "{row}");
        let saved = row["sparse_bytes"].as_f64().unwrap() - row["bytes"].as_f64().unwrap();
        assert!((row["link_saved_us"].as_f64().unwrap() - saved / 52e3).abs() < 1e-9, "{row}");
    }
}
