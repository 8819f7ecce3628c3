//! `papers`: its JSON and files, from records and measured.

use serde_json::Value;

use super::support::{Sandbox, keys, names};

/// Two cores: the figures of 1 and 2, no others.
const THREADS: &str = r#"{"machine": {"cpu": "C", "cores": 2}, "rows": [
    {"stage": "update-aabbs", "scene": "uniform", "n": 100000, "threads": 1, "least_ns": 4000000},
    {"stage": "update-aabbs", "scene": "uniform", "n": 100000, "threads": 2, "least_ns": 3500000}]}"#;

fn claim<'a>(report: &'a Value, paper: usize, label: &str, index: usize) -> &'a Value {
    let entries = report["papers"][paper]["entries"].as_array().unwrap();
    let entry = entries.iter().find(|entry| entry["label"] == label).unwrap();
    &entry["claims"][index]
}

#[test]
fn a_page_of_records_says_what_breaks_and_where_it_comes_from() {
    let sandbox = Sandbox::new();
    let day = sandbox.file("records/2026-01-02-c");
    std::fs::create_dir_all(&day).unwrap();
    std::fs::write(day.join("threads.json"), THREADS).unwrap();
    let arguments = ["papers", "--only-records", "--from", "records", "--out", "page"];
    let report = sandbox.run(&[&arguments[..], &["--json"]].concat()).json();
    let fields = "machine only_records summary breaks holds not_measured papers sources";
    assert_eq!(keys(&report), names(fields));
    let halved = claim(&report, 0, "Figure 12", 0);
    assert_eq!(halved["rows"][0]["from"], "2026-01-02-c/threads.json", "{halved}");
    let text = sandbox.run(&arguments).stdout;
    assert!(text.starts_with("# The papers"), "{text}");
    let read = |name: &str| std::fs::read_to_string(sandbox.file("page").join(name)).unwrap();
    assert_eq!(read("papers.md").trim_end(), text.trim_end());
    assert!(read("papers.html").starts_with("<!DOCTYPE html>"));
    assert_eq!(keys(&serde_json::from_str(&read("papers.json")).unwrap()), names(fields));
}

#[test]
fn a_quick_run_measures_what_a_cpu_can() {
    let sandbox = Sandbox::new();
    let report = sandbox.run(&["papers", "--quick", "--from", ".", "--json"]).json();
    let spheres = claim(&report, 3, "Figure 3", 0);
    assert_eq!(spheres["rows"][0]["from"], "this run", "{spheres}");
    assert_eq!(report["only_records"], false);
    assert_eq!(claim(&report, 1, "Table 7", 0)["verdict"], "not_measured");
}
