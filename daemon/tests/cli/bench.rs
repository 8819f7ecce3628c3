//! `bench latency`: its JSON, and that it measures what it says.

use std::collections::BTreeSet;

use pairmask_tests::stress_scenes;
use serde_json::Value;

use crate::support::{Place, daemon, keys};

/// In the order in which they are printed: the whole frame first.
const STAGES: [&str; 7] =
    ["total_ns", "fill_ns", "answer_ns", "round_trip_ns", "engine_ns", "added_ns", "decode_ns"];

fn check_row(row: &Value, n: u32, backend: &str, wait: &str) {
    let mut fields = BTreeSet::from(["n", "backend", "wait", "engine", "frames"]);
    fields.extend(["precision", "box_bytes", "requests", "decode_threads", "daemon_cpu_percent"]);
    fields.extend(STAGES);
    assert_eq!(keys(row), fields);
    assert_eq!((&row["n"], &row["frames"]), (&n.into(), &12.into()));
    assert_eq!(row["daemon_cpu_percent"].is_number(), backend == "daemon", "{row}");
    check_stages(row, backend, wait);
}

fn check_stages(row: &Value, backend: &str, wait: &str) {
    assert_eq!((&row["backend"], &row["wait"]), (&backend.into(), &wait.into()));
    for stage in STAGES {
        assert_eq!(keys(&row[stage]), BTreeSet::from(["p50", "p90", "p99", "p999", "max"]));
        let at = |name: &str| row[stage][name].as_u64().unwrap();
        let rising = [at("p50"), at("p90"), at("p99"), at("p999"), at("max")];
        assert!(rising.is_sorted(), "{stage}: {rising:?}");
    }
    let longest = |stage: &str| row[stage]["max"].as_u64().unwrap();
    assert!(longest("engine_ns") <= longest("round_trip_ns"), "{row}");
    assert!(longest("round_trip_ns") <= longest("answer_ns"), "{row}");
    assert!(longest("decode_ns") <= longest("answer_ns"), "{row}");
    assert!(longest("answer_ns") <= longest("total_ns"), "{row}");
    assert!(longest("fill_ns") <= longest("total_ns"), "{row}");
    assert!(longest("round_trip_ns") > 0);
}

#[test]
fn rows_for_every_wait_and_scene() {
    let place = Place::new();
    let arguments = [
        "bench",
        "latency",
        "--n",
        "0,100",
        "--frames",
        "12",
        "--warm-up",
        "2",
        "--wait",
        "spin,event",
        "--json",
    ];
    let finished = place.run(&arguments);
    let report = finished.json();
    let places = STAGES.map(|stage| finished.stdout.find(&format!("\"{stage}\"")));
    assert!(places.is_sorted(), "{finished:?}");
    assert_eq!(keys(&report), BTreeSet::from(["machine", "rows"]));
    let machine = &report["machine"];
    let fields = ["cpu", "cores", "os", "kernel", "toolchain", "commit", "command"];
    assert_eq!(keys(machine), BTreeSet::from(fields));
    assert!(machine["toolchain"].as_str().unwrap().starts_with("rustc "), "{machine}");
    assert_eq!(machine["command"], format!("pairmaskd {}", arguments.join(" ")));
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 4);
    for (row, (wait, n)) in
        rows.iter().zip([("spin", 0), ("spin", 100), ("event", 0), ("event", 100)])
    {
        check_row(row, n, "daemon", wait);
    }
    place.assert_clean(&[]);
}

#[test]
fn a_scene_from_a_file_in_process() {
    let place = Place::new();
    place.boxes(&stress_scenes::named("uniform").boxes(70, 1));
    let report = place.run(&[
        "bench",
        "latency",
        "--scene",
        "boxes.f32",
        "--frames",
        "12",
        "--backend",
        "in-process",
        "--json",
    ]);
    check_row(&report.json()["rows"][0], 70, "in-process", "spin");
}

#[test]
fn a_row_for_every_precision() {
    let place = Place::new();
    let precisions = "exact,q16,q8,f16,margin=0.2";
    let report = place.run(&[
        "bench",
        "latency",
        "--n",
        "70",
        "--frames",
        "12",
        "--warm-up",
        "0",
        "--backend",
        "in-process",
        "--precision",
        precisions,
        "--json",
    ]);
    let report = report.json();
    let rows = report["rows"].as_array().unwrap();
    for (row, precision) in rows.iter().zip(precisions.split(',')) {
        check_row(row, 70, "in-process", "spin");
        assert_eq!(row["precision"], precision);
        let bytes = match precision {
            "q8" => 6,
            "q16" | "f16" => 12,
            _ => 24,
        };
        assert_eq!(row["box_bytes"], 70 * bytes);
        let requests = row["requests"].as_u64().unwrap();
        assert_eq!(requests < 12, precision.starts_with("margin"), "{row}");
    }
    assert_eq!(rows.len(), 5);
}

#[test]
fn text_has_a_table_for_each_row() {
    let place = Place::new();
    let finished = place.run(&[
        "bench",
        "latency",
        "--n",
        "10,20",
        "--frames",
        "12",
        "--backend",
        "in-process",
    ]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    for part in ["10 boxes, in-process", "20 boxes, in-process", "p99.9", "decode"] {
        assert!(finished.stdout.contains(part), "{finished:?}");
    }
    let (_, table) = finished.stdout.split_once("µs").unwrap();
    let first = table.lines().nth(1).unwrap();
    assert!(first.starts_with("total"), "{finished:?}");
}

#[test]
fn several_threads_of_the_client_write_and_visit() {
    let place = Place::new();
    let report = place.run(&[
        "bench",
        "latency",
        "--n",
        "40000",
        "--frames",
        "12",
        "--warm-up",
        "0",
        "--decode-threads",
        "2",
        "--json",
    ]);
    let row = &report.json()["rows"][0];
    check_row(row, 40_000, "daemon", "spin");
    assert_eq!(row["decode_threads"], 2);
}

#[test]
fn scenes_exclude_each_other_and_waits_are_checked() {
    let place = Place::new();
    for wrong in [["--n", "1", "--scene", "x"], ["--wait", "patiently", "--frames", "1"]] {
        let mut arguments = vec!["bench", "latency"];
        arguments.extend(wrong);
        assert_eq!(place.run(&arguments).code, Some(2), "{wrong:?}");
    }
    assert!(place.run(&["bench", "latency", "--scene", "absent"]).error(1).contains("absent"));
}

/// Runs a load for a second, and returns its report.
fn load(place: &Place, flags: &[&str]) -> Value {
    let mut arguments = vec!["bench", "latency", "--seconds", "1", "--json"];
    arguments.extend(flags);
    place.run(&arguments).json()
}

fn rows(report: &Value) -> &Vec<Value> {
    report["rows"].as_array().unwrap()
}

/// The rows' rates, sizes and clients, of those that ran at a time.
fn settings(report: &Value) -> Vec<(String, u64, u64, u64)> {
    let number = |row: &Value, name: &str| row[name].as_u64().unwrap();
    let setting = |row: &Value| {
        let rate = row["rate"].as_str().unwrap().to_owned();
        (rate, number(row, "n"), number(row, "clients"), number(row, "clients_in_all"))
    };
    rows(report).iter().map(setting).collect()
}

#[test]
fn a_paced_client_has_a_row_for_every_rate_and_size() {
    let place = Place::new();
    let flags = ["--rate", "closed,50,200", "--n", "0,100"];
    let report = load(&place, &flags);
    let expected = ["closed", "50", "200"]
        .iter()
        .flat_map(|rate| [0, 100].map(|n| ((*rate).to_owned(), n, 1, 1)))
        .collect::<Vec<_>>();
    assert_eq!(settings(&report), expected);
    for row in rows(&report) {
        check_stages(row, "daemon", "serve");
        assert!(row["daemon_cpu_percent"].is_number(), "{row}");
        let due = &row["from_due_ns"];
        assert_eq!(keys(due), BTreeSet::from(["p50", "p90", "p99", "p999", "max"]));
        let frames = row["frames"].as_u64().unwrap();
        if row["rate"] == "closed" {
            assert_eq!((&due["max"], &row["late_frames"]), (&0.into(), &0.into()), "{row}");
            assert!(frames > 0, "{row}");
        } else {
            // An open loop leaves no frame out, however slow the machine is.
            let rate: u64 = row["rate"].as_str().unwrap().parse().unwrap();
            assert_eq!(frames, rate, "{row}");
            let longest = |stage: &str| row[stage]["max"].as_u64().unwrap();
            assert!(longest("from_due_ns") >= longest("total_ns"), "{row}");
        }
    }
    let idle = &report["idle"][0];
    assert_eq!(keys(idle), BTreeSet::from(["wait", "clients", "daemon_cpu_percent"]));
    assert_eq!((&idle["wait"], &idle["clients"]), (&"serve".into(), &1.into()));
    place.assert_clean(&[]);
}

#[test]
fn clients_are_counted_together_and_of_differing_sizes_apart() {
    let place = Place::new();
    let report = load(&place, &["--clients", "1,3", "--n", "100", "--wait", "event"]);
    assert_eq!(settings(&report), [("closed".into(), 100, 1, 1), ("closed".into(), 100, 3, 3)]);
    for row in rows(&report) {
        check_stages(row, "daemon", "event");
        assert!(row["frames_per_second"].as_f64().unwrap() > 0.0, "{row}");
        let worst = row["worst_client_p50_ns"].as_u64().unwrap();
        assert!(worst >= row["round_trip_ns"]["p50"].as_u64().unwrap() || row["clients"] == 1);
    }
    let report = load(&place, &["--mix", "70x2,1000x1", "--rate", "100"]);
    assert_eq!(settings(&report), [("100".into(), 70, 2, 3), ("100".into(), 1000, 1, 3)]);
    let frames: Vec<u64> = rows(&report).iter().map(|r| r["frames"].as_u64().unwrap()).collect();
    assert_eq!(frames, [200, 100]);
    place.assert_clean(&[]);
}

#[test]
fn a_load_may_run_in_process_and_on_a_daemon_that_serves() {
    let place = Place::new();
    let report = load(&place, &["--rate", "100", "--n", "70", "--backend", "in-process"]);
    check_stages(&rows(&report)[0], "in-process", "serve");
    assert!(rows(&report)[0]["daemon_cpu_percent"].is_null());
    assert_eq!(report.get("idle"), None);
    let daemon = daemon();
    let dir = daemon.dir();
    let there = ["--runtime-dir", dir.path().to_str().unwrap(), "--instance", "default"];
    let report = load(&place, &[&there[..], &["--rate", "100", "--n", "70"]].concat());
    check_stages(&rows(&report)[0], "daemon", "serve");
    assert!(rows(&report)[0]["daemon_cpu_percent"].is_number());
}

#[test]
fn the_text_of_a_load_says_who_asked_and_what_the_daemon_used() {
    let place = Place::new();
    let arguments = ["bench", "latency", "--seconds", "1", "--rate", "50", "--n", "70"];
    let finished = place.run(&arguments);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    for part in ["1 client at 50 Hz", "% of a core", "\nfrom due ", "idle (serve): while 1 client"]
    {
        assert!(finished.stdout.contains(part), "{part}: {finished:?}");
    }
}

#[test]
fn clients_that_cannot_connect_are_told_of_once() {
    let place = Place::new();
    let absent = ["bench", "latency", "--clients", "3", "--instance", "nobody"];
    let finished = place.run(&[&absent[..], &["--backend", "daemon"]].concat());
    let error = finished.error(1);
    assert!(error.contains("a client process failed: ") && error.contains("nobody"), "{error}");
}
