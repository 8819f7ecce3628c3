//! `accuracy`: its rows, its verdicts and its files.

use serde_json::Value;

use super::support::{Finished, Sandbox, keys, names};

const FIELDS: &str = "scene n mode margin offset spheres backend engine served_by_engine frames \
    requests times bytes_up bytes_down checked_frames true_pairs missed extra \
    extra_ratio precision error_percent against_boxes memory_bytes";

fn run(sandbox: &Sandbox, more: &[&str]) -> Finished {
    let mut arguments = vec!["accuracy", "--frames", "8", "--warm-up", "1", "--checked", "2"];
    arguments.extend(more);
    sandbox.run(&arguments)
}

fn check_rows(report: &Value, expected: usize, backend: &str) {
    assert_eq!(keys(report), names("machine seed rows pareto"));
    assert_eq!(keys(&report["pareto"]), names("axes modes nowhere"));
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), expected);
    for row in rows {
        assert_eq!(keys(row), names(FIELDS));
        assert_eq!((&row["missed"], &row["checked_frames"]), (&0.into(), &2.into()), "{row}");
        let backend = if row["mode"] == "spheres" { "in-process" } else { backend };
        assert_eq!((&row["backend"], &row["frames"]), (&backend.into(), &8.into()), "{row}");
        assert!(row["true_pairs"].as_u64().unwrap() > 0 && row["memory_bytes"].as_u64() > Some(0));
        assert_eq!(row["times"].as_object().unwrap().len(), 9, "{row}");
        assert!(row["mode"] != "exact" || row["extra"] == 0, "{row}");
        let requests = row["requests"].as_u64().unwrap();
        assert!(requests > 0 && (requests < 8) == (row["mode"] == "margin"), "{row}");
        assert!(row["bytes_up"].as_u64() > Some(0) && row["bytes_down"].as_u64() > Some(0));
        let margin = if row["mode"] == "margin" { 0.1.into() } else { Value::Null };
        assert_eq!(row["margin"], margin, "{row}");
        let mode = row["mode"].as_str().unwrap();
        let is_world = ["f64", "plain-f32"].contains(&mode);
        assert_eq!(row["offset"], if is_world { 1e9.into() } else { Value::Null }, "{row}");
        let spheres = if mode == "spheres" { "circumscribed".into() } else { Value::Null };
        assert_eq!(row["spheres"], spheres, "{row}");
        assert_eq!(row["against_boxes"].is_object(), mode == "spheres", "{row}");
        if mode == "spheres" {
            assert!(row["extra"] == 0 && row["against_boxes"]["missed"] == 0, "{row}");
            assert!(row["against_boxes"]["extra"].as_u64() > Some(0), "{row}");
        }
    }
}

#[test]
fn rows_for_every_mode_scene_and_engine() {
    let sandbox = Sandbox::new();
    let scenes = ["--scene", "uniform,pile", "--n", "345", "--json"];
    let report = run(&sandbox, &scenes).json();
    check_rows(&report, 2 * 8, "daemon");
    for mode in ["f64", "plain-f32", "spheres"] {
        let rows = report["rows"].as_array().unwrap();
        assert_eq!(rows.iter().filter(|row| row["mode"] == mode).count(), 2, "{mode}");
    }
    // Rounded to the nearest f32 so far from the origin, nearly every box overlaps nearly every
    // other.
    let extra_of = |mode: &str| -> u64 {
        let rows = report["rows"].as_array().unwrap().iter().filter(|row| row["mode"] == mode);
        rows.map(|row| row["extra"].as_u64().unwrap()).sum()
    };
    assert!(extra_of("f64") * 1000 < extra_of("plain-f32") && extra_of("q8") > 0, "{report}");
    let fields = "mode settings disqualified on_front at";
    for verdict in report["pareto"]["modes"].as_array().unwrap() {
        assert_eq!(keys(verdict), names(fields), "{verdict}");
        let nowhere = report["pareto"]["nowhere"].as_array().unwrap().contains(&verdict["mode"]);
        assert_eq!(nowhere, verdict["on_front"] == 0, "{verdict}");
    }
    sandbox.assert_clean(&[]);
    let engines =
        ["--backend", "in-process", "--precision", "q8", "--engines", "cpu-brute,cpu-sap,cpu-grid"];
    check_rows(&run(&sandbox, &[&scenes[..], &engines[..]].concat()).json(), 2 * 3, "in-process");
}

#[test]
fn verdicts_and_files() {
    let sandbox = Sandbox::new();
    let base = ["--scene", "uniform", "--n", "345", "--backend", "in-process", "--precision", "q8"];
    let with = |more: &[&str]| run(&sandbox, &[&base[..], more].concat());
    let kept = with(&["--out", "before"]);
    assert_eq!(kept.code, Some(0), "{kept:?}");
    assert!(kept.stdout.contains("q8") && kept.stdout.contains("p99"), "{kept:?}");

    assert!(kept.stdout.contains("| everywhere"), "{kept:?}");
    let csv = std::fs::read_to_string(sandbox.file("before/accuracy.csv")).unwrap();
    assert!(csv.contains(",times.total_ns.p50,times.total_ns.p99,"), "{csv}");
    let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert!(columns.len() == 2 && columns[0] == columns[1], "{csv}");
    let page = std::fs::read_to_string(sandbox.file("before").join("report.html")).unwrap();
    assert!(page.contains("No pair was missed") && page.trim_end().ends_with("</html>"));
    let path = sandbox.file("before").join("accuracy.json");
    let before: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    check_rows(&before, 1, "in-process");
}
