//! `plan` and `threads`: their JSON, and that figures agree.

use serde_json::Value;

use super::support::{Sandbox, keys, names};

fn rows(report: &Value) -> &[Value] {
    assert_eq!(keys(&report["machine"]).len(), 7, "{report}");
    report["rows"].as_array().unwrap()
}

#[test]
fn the_plan_is_judged_scene_by_scene() {
    let sandbox = Sandbox::new();
    let line = "plan --scene uniform,rods --n 70,600 --threads 1";
    let report = sandbox.run_line(&format!("{line} --json")).json();
    assert!(report["calibration"].as_str().unwrap().starts_with("built in"), "{report}");
    assert_eq!(rows(&report).len(), 4);
    for row in rows(&report) {
        let ns = |name: &str| row[name].as_u64().unwrap();
        assert_eq!((&row["threads"], &row["engine_threads"]), (&1.into(), &1.into()));
        assert!(ns("planned_ns") > 0 && ns("best_ns") > 0, "{row}");
        let ratio = ns("planned_ns") as f64 / ns("best_ns") as f64;
        assert!((row["ratio"].as_f64().unwrap() - ratio).abs() < 1e-9, "{row}");
    }
    let text = sandbox.run_line(line).stdout;
    assert!(text.contains("of 4 above 1.15"), "{text}");
}

#[test]
fn speed_ups_stand_beside_the_papers() {
    let sandbox = Sandbox::new();
    let line = "threads --scene cubes,uniform --n 300 --threads 2 --json --out figures";
    let report = sandbox.run_line(line).json();
    let fields = "stage scene n engine threads frames least_ns median_ns speed_up paper_ns \
        paper_speed_up";
    // Two scenes, one or two threads: the first stage, and the second with four engines.
    assert_eq!(rows(&report).len(), 2 * 2 * 5);
    for row in rows(&report) {
        assert_eq!(keys(row), names(fields));
        assert_eq!(row["engine"].is_null(), row["stage"] == "update-aabbs", "{row}");
        assert_eq!(row["paper_ns"].is_null(), row["scene"] == "uniform", "{row}");
        let is_known = row["stage"] == "overlapping-pairs" && row["scene"] == "cubes";
        assert!(row["paper_ns"] == 31_650_000 || !is_known || row["threads"] != 2, "{row}");
    }
    for of_one_and_two in rows(&report).chunks(2) {
        let [one, two] = [0, 1].map(|i| of_one_and_two[i]["least_ns"].as_u64().unwrap() as f64);
        let speed_ups = [0, 1].map(|i| of_one_and_two[i]["speed_up"].as_f64().unwrap());
        assert!(speed_ups[0] == 1.0 && (speed_ups[1] - one / two).abs() < 1e-9, "{report}");
    }
    let csv = std::fs::read_to_string(sandbox.file("figures/threads.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + rows(&report).len());
    assert_eq!(csv.lines().next().unwrap().split(',').count(), names(fields).len());
    assert!(csv.contains("update-aabbs,cubes,300,,2,"), "{csv}");
    let written = std::fs::read_to_string(sandbox.file("figures/threads.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), report);
}
