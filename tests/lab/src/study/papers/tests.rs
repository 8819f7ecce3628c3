//! The claims, judged without records and by made-up ones.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use serde_json::json;

use super::claims::Row;
use super::expression::Scope;
use super::records::ms_on_gpus;
use super::rule::{Rule, Verdict};
use super::*;
use crate::study::harness::{html, markdown};

/// A report of no record: what the code alone decides.
fn empty() -> PapersReport {
    let mut figures = Figures::default();
    figures.join();
    PapersReport::of(machine_with(None), true, &figures).expect("claims")
}

#[test]
fn every_table_and_figure_is_listed_and_without_records_nothing_is_invented() {
    let report = empty();
    assert!(report.sources.is_empty());
    // Figures 1 to 15; tables 1 to 7 and figures 1 to 6; figures 1 to 15; table 1, figures 1 to 8.
    let counts: Vec<_> =
        report.summary().iter().map(|row| row["tables_and_figures"].clone()).collect();
    assert_eq!(counts, [15, 13, 15, 9]);
    let mut table_1 = Vec::new();
    for paper in &report.papers {
        let labels: BTreeSet<_> = paper.entries.iter().map(|entry| &entry.label).collect();
        assert_eq!(labels.len(), paper.entries.len(), "{}", paper.name);
        for entry in &paper.entries {
            let says = entry.claims.is_empty() == entry.nothing_to_measure.is_some();
            assert!(says, "{} {}", paper.name, entry.label);
        }
        for (entry, claim) in paper.claims() {
            let is_code = entry.label == "Table 1" && claim.says.contains("pair");
            assert_eq!(claim.verdict == Verdict::NotMeasured, !is_code, "{claim:?}");
            assert!(is_code || !claim.why.is_empty(), "{claim:?}");
            let ours = claim.rows.last().and_then(|row| row.ours);
            table_1.extend(is_code.then_some((claim.verdict, ours)));
        }
    }
    // The paper's examples are right, and its last number is not.
    let expected = [(Verdict::Holds, Some(46_108.0)), (Verdict::Breaks, Some(499_499.0))];
    assert_eq!(table_1, expected);
    let claims: usize = report.papers.iter().map(|paper| paper.claims().count()).sum();
    let verdicts = [Verdict::Breaks, Verdict::Holds, Verdict::NotMeasured];
    let sentences = verdicts.map(|verdict| report.sentences(verdict).len());
    assert_eq!(sentences.iter().sum::<usize>(), claims);
}

#[test]
fn the_pages_show_every_table_and_figure_and_load_nothing() {
    let report = empty();
    let parts = report.report().parts;
    let (text, html) = (markdown(&parts), html(&parts));
    for loading in ["http://", "https://", "src=", "<link", "<script", "@import", "url("] {
        assert!(!html.contains(loading), "{loading}");
    }
    let entries = report.papers.iter().map(|paper| paper.entries.len()).sum::<usize>();
    assert_eq!((html.matches("<h3>").count(), text.matches("\n### ").count()), (entries, entries));
    let label = |part: &str| text.find(part).unwrap_or_else(|| panic!("no {part}:\n{text}"));
    let parts = ["| paper ", "## What breaks", "## What holds", "## Avril 2009", "## Suaib 2015"];
    assert!(parts.map(label).is_sorted(), "{text}");
    assert!(text.contains("ours 499499, the paper's 499500"), "{text}");
}

#[test]
fn every_expression_is_one_and_names_what_there_is() {
    let defined = BTreeMap::from([("half".to_owned(), "list[name=@1].x / 2".to_owned())]);
    let root = json!({"list": [
        {"name": "a", "x": 3, "deep": {"y": 7}}, {"name": "b c", "x": 8, "is": true}, {"x": null},
    ]});
    let scope = Scope { root: &root, defined: &defined };
    for (text, value) in [
        ("1 + 2 * 3 - 4 / 2", Some(5.0)),
        ("(1 + 2) * 3", Some(9.0)),
        ("1 + 2 <= 3", Some(1.0)),
        ("1 + 2 < 3", Some(0.0)),
        ("half(b c) + list[name=a].deep.y", Some(11.0)),
        ("list[name=a|b c,x<=8,is=true].x", Some(8.0)),
        ("list[name=d].x + 1", None),
        ("pair_number(75, 303)", Some(71_452.0)),
    ] {
        assert_eq!(scope.value(text), Ok(value), "{text}");
    }
    for text in ["", "1 +", "(1", "nobody(1)", "1 2", "list[name=a"] {
        assert!(scope.value(text).is_err(), "{text}");
    }
}

fn rows(figures: &[(f64, f64)]) -> Vec<Row> {
    let row = |(i, (paper, ours)): (usize, &(f64, f64))| Row {
        what: format!("r{i}"),
        unit: "s".to_owned(),
        paper: Some(*paper),
        ours: Some(*ours),
        ..Row::default()
    };
    figures.iter().enumerate().map(row).collect()
}

fn rule(name: &str) -> Rule {
    Rule::named(name, &DATA.rules).expect("a rule")
}

#[test]
fn every_rule_can_hold_and_can_break() {
    type Two = [(f64, f64); 2];
    let cases: [(&str, Two, Two); 13] = [
        ("no_more", [(2.0, 1.0), (2.0, 2.0)], [(2.0, 1.0), (2.0, 2.1)]),
        ("reaches", [(2.0, 1.8), (2.0, 9.0)], [(2.0, 9.0), (2.0, 1.7)]),
        ("within", [(50.0, 54.0), (50.0, 1.0)], [(50.0, 1.0), (50.0, 56.0)]),
        ("rounds_to", [(2.0, 1.5), (3.0, 2.6)], [(2.0, 1.5), (3.0, 2.4)]),
        ("equals", [(7.0, 7.0), (8.0, 8.0)], [(7.0, 7.0), (8.0, 7.0)]),
        ("same_share", [(1.0, 1.09), (1.0, 0.91)], [(1.0, 1.0), (1.0, 0.8)]),
        ("same_side(1)", [(0.6, 0.1), (1.2, 2.0)], [(0.6, 0.1), (1.2, 0.9)]),
        ("at_most(0)", [(0.0, 0.0), (0.0, 0.0)], [(0.0, 0.0), (0.0, 1.0)]),
        ("at_least(5)", [(8.0, 5.0), (8.0, 6.0)], [(8.0, 5.0), (8.0, 4.9)]),
        ("between(-1, 2)", [(1.0, -0.9), (1.0, 1.9)], [(1.0, 1.1), (1.0, 2.0)]),
        ("rises", [(1.0, 1.0), (1.0, 1.1)], [(1.0, 1.0), (1.0, 1.0)]),
        ("falls", [(1.0, 1.0), (1.0, 0.9)], [(1.0, 1.0), (1.0, 0.99)]),
        ("is_constant", [(1.0, 1.0), (1.0, 1.09)], [(1.0, 1.0), (1.0, 1.2)]),
    ];
    assert_eq!(cases.len(), DATA.rules.len());
    for (name, kept, broken) in cases {
        let (rule, kept, broken) = (rule(name), rows(&kept), rows(&broken));
        assert_eq!(rule.judge(&kept), Ok((Verdict::Holds, Vec::new())), "{name}");
        assert_eq!(rule.judge(&broken), Ok((Verdict::Breaks, vec![&broken[1]])), "{name}");
    }
    assert_eq!(rule("between(-0.5, 2)").says, "ours is between -0.5 and 2");
}

#[test]
fn the_evidence_is_what_decided_and_a_missing_figure_hides_no_break() {
    let judge = |name: &str, rows: &[Row]| rule(name).judge(rows).expect("conditions").0;
    let evidence = |name: &str, rows: &[Row]| {
        let rule = rule(name);
        rule.evidence(rows, &rule.judge(rows).expect("conditions").1)
    };
    let mut rows = rows(&[(1.0, 1.0), (1.0, 2.0), (1.0, 2.0), (1.0, 1.0)]);
    for row in &mut rows {
        row.paper = None;
    }
    let (rises, at_most) = ("rises", "at_most(1)");
    assert_eq!(evidence(rises, &rows), "r1: ours 2 s; r2: ours 2 s; and 1 more");
    assert_eq!(evidence(at_most, &rows[..2]), "r1: ours 2 s");
    assert_eq!(judge("reaches", &rows), Verdict::Holds, "theirs is missing");
    rows[0].ours = None;
    assert_eq!(judge("at_most(2)", &rows), Verdict::NotMeasured);
    assert_eq!(judge(at_most, &rows), Verdict::Breaks);
    assert_eq!(judge(rises, &[]), Verdict::NotMeasured);
}

/// The page of the records in the folders of a folder.
fn page_of(records: &Path) -> Result<PapersReport> {
    let from = Some(records.to_owned());
    make(&PapersOptions { only_records: true, from, ..PapersOptions::default() }, || ())
}

fn claim<'a>(report: &'a PapersReport, paper: usize, label: &str, index: usize) -> &'a Claim {
    let entry = report.papers[paper].entries.iter().find(|entry| entry.label == label);
    &entry.expect("an item").claims[index]
}

/// Of each claim all figures are those of one record, the newest that has most; threads beyond the cores are none.
#[test]
fn records_are_read_newest_first_and_a_broken_one_is_an_error() {
    let threads = |times: &str| {
        let row = |time: &str| {
            let (threads, ns) = time.split_once(':').expect("threads:ns");
            format!(
                r#"{{"stage":"update-aabbs","scene":"uniform","n":100000,"threads":{threads},"least_ns":{ns}}}"#
            )
        };
        let rows: Vec<String> = times.split(' ').map(row).collect();
        format!(r#"{{"machine":{{"cpu":"C","cores":4}},"rows":[{}]}}"#, rows.join(","))
    };
    let folder = tempfile::tempdir().expect("a folder");
    for (day, times) in [
        ("2026-03-01-c", "1:9000000"),
        ("2026-02-01-b", "1:8000000 2:4000000 4:3000000 8:1000000"),
        ("2026-01-01-a", "1:8000000 2:5000000 4:4000000"),
    ] {
        fs::create_dir(folder.path().join(day)).expect("a folder");
        fs::write(folder.path().join(day).join("threads.json"), threads(times)).expect("a file");
    }
    let report = page_of(folder.path()).expect("a page");
    let halved = claim(&report, 0, "Figure 12", 0);
    assert_eq!((halved.verdict, halved.rows[0].ours), (Verdict::Holds, Some(2.0)));
    let more = claim(&report, 0, "Figure 12", 1);
    let ours: Vec<_> = more.rows.iter().map(|row| row.ours).collect();
    assert_eq!(ours, [Some(4.0 / 3.0), None]);
    assert_eq!(more.rows[0].from.as_deref(), Some("2026-02-01-b/threads.json"));
    assert!(more.why.ends_with("the largest has 4"), "{}", more.why);
    assert_eq!(report.sources.len(), 1);
    fs::write(folder.path().join("2026-01-01-a/grid.json"), "{}").expect("a file");
    let error = page_of(folder.path()).expect_err("no grid");
    assert!(error.to_string().contains("grid.json"), "{error}");
}

#[test]
fn the_scene_that_gains_most_from_a_second_gpu_decides() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("r")).expect("a folder");
    let verdicts = |two_ms: f64| {
        let scene =
            |scene, two_ms| json!({"scene": scene, "n": 1e6, "one_ms": 1.0, "two_ms": two_ms});
        let text = json!({"scenes": [scene("a", 0.98), scene("b", two_ms)]}).to_string();
        fs::write(folder.path().join("r/several-gpus.json"), text).expect("a file");
        let report = page_of(folder.path()).expect("a page");
        let large = claim(&report, 2, "Figure 14", 2);
        let best = if two_ms < 0.98 { "b" } else { "a" };
        assert_eq!(large.rows[0].what, format!("{best}, 2 GPUs over 1"));
        for index in 3..6 {
            let simulated = claim(&report, 2, "Figure 14", index);
            assert!(simulated.note.starts_with("Simulated, not measured"), "{simulated:?}");
            assert!(simulated.rows.iter().any(|row| row.what.contains("simulated")));
        }
        [2, 3, 4, 5].map(|index| claim(&report, 2, "Figure 14", index).verdict)
    };
    // Each further GPU costs 35 µs: eight are no faster than four.
    let [holds, breaks] = [Verdict::Holds, Verdict::Breaks];
    assert_eq!(verdicts(0.75), [breaks, holds, breaks, holds]);
    assert_eq!(verdicts(0.5)[0], holds);
    assert_eq!(verdicts(1.5)[1], breaks);
}

#[test]
fn one_gpu_and_two_take_what_was_measured_and_no_more_is_shared_than_there_is() {
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} for {b}");
    let ms = |both, gpus, in_slabs| ms_on_gpus(both, 1e6, gpus, in_slabs);
    let measured = [1.659, 1.2];
    near(ms(measured, 1, false), 1.659);
    near(ms(measured, 2, false), 1.2);
    near(ms(measured, 1, true), 1.659);
    // 24 MB at 54 GB/s.
    near(ms(measured, 2, false) - ms(measured, 2, true), 0.5 * 24.0 / 54.0);
    near(ms([1.0, 1.5], 8, false), 1.0 + 7.0 * 0.035);
    assert!(ms([1.0, 0.1], 4, false) > 24.0 / 54.0);
    // Reading alone takes longer than the frame: then that is all there is.
    near(ms([0.1, 0.1], 1, false), 0.1);
}
