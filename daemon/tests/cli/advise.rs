//! `advise`: of a recording and of files of boxes, as text, JSON and a picture.

use serde_json::Value;

use crate::support::{Sandbox, keys, names};

const FIELDS: &str =
    "machine file boxes moving ticks notes advice near plainest rows failed sizes take_overs code";
const ROW: &str =
    "way what who threads may_be_near rounds ticks usual_ns p50_ns p99_ns cpu_ns pairs";

/// What holds of every report, whatever was fastest.
fn check(report: &Value) {
    assert_eq!(keys(report), names(FIELDS));
    let rows = report["rows"].as_array().unwrap();
    assert!(rows.len() >= 2, "{report}");
    for row in rows {
        assert_eq!(keys(row), names(ROW));
        assert!(row["ticks"].as_u64() > Some(0) && row["usual_ns"].as_u64() > Some(0), "{row}");
    }
    let advised = rows.iter().find(|row| row["way"] == report["advice"]).unwrap();
    assert_eq!(advised["rounds"], 4, "it was measured to the end: {advised}");
    assert_eq!(advised["may_be_near"], false);
    let code = report["code"].as_array().unwrap();
    assert_eq!(code[0], "let mut session = Session::builder()");
}

#[test]
fn a_recording_is_advised_on_by_what_its_program_asks() {
    let sandbox = Sandbox::new();
    let recordings = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/recordings");
    for (name, note, code) in [
        ("sensors", "It asks for pairs of two sets", "split_at: Some(100)"),
        ("several-processes", "a shared scene alone serves it", ".with_shared("),
        ("robot-arm", "It asks queries: a scene alone serves it.", "Report::Changes"),
    ] {
        let line = format!("advise {recordings}/{name}.pmrec --gpu none --seconds 1 --json");
        let finished = sandbox.run_line(&line);
        let report = finished.json();
        check(&report);
        assert_eq!(report["failed"], Value::Array(vec![]), "{name}");
        let notes = report["notes"].to_string();
        assert!(notes.contains(note), "{name}: {notes}");
        let lines = report["code"].to_string();
        assert!(lines.contains(code), "{name}: {lines}");
    }
    let line = format!("advise {recordings}/sensors.pmrec --moving 0.5");
    let finished = sandbox.run_line(&line);
    assert!(finished.error(2).contains("a recording says itself"), "{finished:?}");
    sandbox.assert_clean(&[]);
}

#[test]
fn a_file_of_boxes_is_set_in_motion_and_compared_at_several_sizes() {
    let sandbox = Sandbox::new();
    for file in ["boxes.txt", "boxes.npy"] {
        assert_eq!(sandbox.run_line(&format!("scene uniform 300 {file}")).code, Some(0));
    }
    let line = "advise boxes.npy --gpu none --seconds 2 --changes --json --picture a.svg";
    let report = sandbox.run_line(line).json();
    check(&report);
    assert_eq!((&report["boxes"], &report["file"]), (&300.into(), &"boxes.npy".into()));
    assert!(report["notes"][0].as_str().unwrap().starts_with("Assumed: 10 % of the boxes move"));
    assert!(!report["sizes"].as_array().unwrap().is_empty(), "{report}");
    assert_eq!(report["take_overs"][0]["from_boxes"], 0);
    let ways = report["rows"].to_string();
    for way in ["frame, in process", "frame, q16, daemon", "scene, margin ", ", near, "] {
        assert!(ways.contains(way), "{way}: {ways}");
    }
    let picture = std::fs::read_to_string(sandbox.file("a.svg")).unwrap();
    assert!(picture.starts_with("<svg ") && picture.contains("A tick by the number of boxes"));

    let finished = sandbox.run_line("advise boxes.txt --gpu none --seconds 1 --moving 0");
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""), "{finished:?}");
    let text = &finished.stdout;
    assert!(text.lines().all(|line| line.chars().count() <= 80), "fits a terminal: {text}");
    for part in ["0 % move a tick", "\n> ", "\nadvice: ", "\nsizes: ", "    let mut session = "] {
        assert!(text.contains(part), "{part}: {text}");
    }
    for (line, code, expected) in [
        ("advise absent", 1, "there is no such file"),
        ("advise boxes.txt --moving 2", 2, "must be a share from 0 to 1"),
        ("advise boxes.txt --json --picture -", 2, "name a file"),
    ] {
        let finished = sandbox.run_line(line);
        assert!(finished.error(code).contains(expected), "{finished:?}");
    }
    sandbox.assert_clean(&["boxes.txt", "boxes.npy", "a.svg"]);
}
