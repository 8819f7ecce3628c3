//! `bench latency`: its JSON, and that it measures what it says.

use pairmask_tests::stress_scenes;
use serde_json::Value;

use crate::support::{Finished, Sandbox, keys, names};

/// In the order in which they are printed: the whole frame first.
const STAGES: [&str; 7] =
    ["total_ns", "fill_ns", "answer_ns", "round_trip_ns", "engine_ns", "added_ns", "decode_ns"];

/// Measures twelve frames.
fn latency(sandbox: &Sandbox, flags: &str) -> Finished {
    sandbox.run_line(&format!("bench latency --frames 12 {flags}"))
}

fn check_row(row: &Value, n: u32, backend: &str, wait: &str) {
    let mut fields = names(
        "n backend wait engine frames precision box_bytes requests decode_threads daemon_cpu_percent \
         daemon_cpu_ns client_cpu_ns",
    );
    fields.extend(STAGES);
    assert_eq!(keys(row), fields);
    assert_eq!((&row["n"], &row["frames"]), (&n.into(), &12.into()));
    for of_daemon in ["daemon_cpu_percent", "daemon_cpu_ns"] {
        assert_eq!(row[of_daemon].is_number(), backend == "daemon", "{row}");
    }
    assert!(row["client_cpu_ns"].as_u64() > Some(0), "{row}");
    assert_eq!((&row["backend"], &row["wait"]), (&backend.into(), &wait.into()));
    for stage in STAGES {
        assert_eq!(keys(&row[stage]), names("p50 p90 p99 p999 max"));
        let at = |name: &str| row[stage][name].as_u64().unwrap();
        let rising = [at("p50"), at("p90"), at("p99"), at("p999"), at("max")];
        assert!(rising.is_sorted(), "{stage}: {rising:?}");
    }
    let longest = |stage: &str| row[stage]["max"].as_u64().unwrap();
    for (part, whole) in [
        ("engine_ns", "round_trip_ns"),
        ("round_trip_ns", "answer_ns"),
        ("decode_ns", "answer_ns"),
        ("answer_ns", "total_ns"),
        ("fill_ns", "total_ns"),
    ] {
        assert!(longest(part) <= longest(whole), "{part}: {row}");
    }
    assert!(longest("round_trip_ns") > 0);
}

#[test]
fn rows_for_every_wait_and_scene() {
    let sandbox = Sandbox::new();
    let flags = "--n 0,100 --warm-up 2 --wait spin,event --json";
    let finished = latency(&sandbox, flags);
    let report = finished.json();
    let sandboxes = STAGES.map(|stage| finished.stdout.find(&format!("\"{stage}\"")));
    assert!(sandboxes.is_sorted(), "{finished:?}");
    assert_eq!(keys(&report), names("machine rows"));
    let machine = &report["machine"];
    assert_eq!(keys(machine), names("cpu cores os kernel toolchain commit command"));
    assert!(machine["toolchain"].as_str().unwrap().starts_with("rustc "), "{machine}");
    assert_eq!(machine["command"], format!("pairmaskd bench latency --frames 12 {flags}"));
    let rows = report["rows"].as_array().unwrap();
    let expected = [("spin", 0), ("spin", 100), ("event", 0), ("event", 100)];
    assert_eq!(rows.len(), expected.len());
    for (row, (wait, n)) in rows.iter().zip(expected) {
        check_row(row, n, "daemon", wait);
    }
    sandbox.assert_clean(&[]);
}

#[test]
fn a_row_for_a_scene_from_a_file_and_for_every_precision() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&stress_scenes::named("uniform").boxes(70, 1));
    let precisions = "exact,q16,q8,f16,margin=0.2";
    let flags = "--backend in-process --warm-up 0 --json";
    let report = latency(&sandbox, &format!("--scene boxes.f32 {flags}")).json();
    check_row(&report["rows"][0], 70, "in-process", "spin");
    let report = latency(&sandbox, &format!("--n 70 {flags} --precision {precisions}")).json();
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
    let finished = latency(&Sandbox::new(), "--n 10,20 --backend in-process");
    assert_eq!(finished.code, Some(0), "{finished:?}");
    for part in ["10 boxes, in-process", "20 boxes, in-process", "a frame: client", "decode"] {
        assert!(finished.stdout.contains(part), "{finished:?}");
    }
    let (_, table) = finished.stdout.split_once("\nµs").unwrap();
    assert!(table.lines().nth(1).unwrap().starts_with("total"), "{finished:?}");
}

#[test]
fn several_threads_of_the_client_write_and_iterate() {
    let report = latency(&Sandbox::new(), "--n 40000 --warm-up 0 --decode-threads 2 --json").json();
    check_row(&report["rows"][0], 40_000, "daemon", "spin");
    assert_eq!(report["rows"][0]["decode_threads"], 2);
}
