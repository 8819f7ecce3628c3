//! `status --metrics` and `serve --metrics-file`: their formats, and that the dashboard asks for what there is.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use pairmask::{Report, SceneOptions};
use pairmask_core::Aabb;
use rustix::process::Signal;
use serde_json::Value;

use crate::support::{Sandbox, Serving, eventually};

/// A sample: its name, its labels and its value.
type Sample = (String, BTreeMap<String, String>, f64);

/// A sample of a line, by the grammar of `OpenMetrics` without timestamps and exemplars.
fn sample(line: &str) -> Result<Sample, String> {
    let wrong = |what: &str| format!("{what}: {line}");
    let end = line.find(['{', ' ']).ok_or_else(|| wrong("no value"))?;
    let (name, mut rest) = line.split_at(end);
    let is_name = |name: &str| {
        !name.is_empty()
            && !name.starts_with(|c: char| c.is_ascii_digit())
            && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    if !is_name(name) {
        return Err(wrong("no name"));
    }
    let mut labels = BTreeMap::new();
    if let Some(after) = rest.strip_prefix('{') {
        rest = after;
        loop {
            let (label, after) = rest.split_once("=\"").ok_or_else(|| wrong("no label"))?;
            let (mut value, mut chars) = (String::new(), after.char_indices());
            let end = loop {
                match chars.next() {
                    Some((at, '"')) => break at,
                    Some((_, '\\')) => match chars.next() {
                        Some((_, 'n')) => value.push('\n'),
                        Some((_, c @ ('"' | '\\'))) => value.push(c),
                        _ => return Err(wrong("wrong escape")),
                    },
                    Some((_, c)) => value.push(c),
                    None => return Err(wrong("no end of a label")),
                }
            };
            if !is_name(label) || labels.insert(label.to_owned(), value).is_some() {
                return Err(wrong("wrong label"));
            }
            rest = &after[end + 1..];
            match (rest.strip_prefix(','), rest.strip_prefix('}')) {
                (Some(after), _) => rest = after,
                (None, Some(after)) => break rest = after,
                (None, None) => return Err(wrong("no end of labels")),
            }
        }
    }
    let value = rest.strip_prefix(' ').and_then(|value| value.parse().ok());
    Ok((name.to_owned(), labels, value.ok_or_else(|| wrong("no value"))?))
}

/// Checks that a text is `OpenMetrics` 1.0, as far as gauges and counters go: its samples.
fn openmetrics(text: &str) -> Result<Vec<Sample>, String> {
    let body = text.strip_suffix("# EOF\n").ok_or("it does not end with # EOF")?;
    let (mut samples, mut seen): (Vec<Sample>, BTreeSet<String>) = Default::default();
    // Family, type, unit, and whether it has samples.
    let mut family = (String::new(), String::new(), String::new(), false);
    for line in body.lines() {
        let wrong = |what: &str| Err(format!("{what}: {line}"));
        if let Some(rest) = line.strip_prefix("# ") {
            let mut words = rest.splitn(3, ' ');
            let [what, name, value] = [(); 3].map(|()| words.next().unwrap_or_default());
            if name != family.0 {
                if !seen.insert(name.to_owned()) {
                    return wrong("a family that was there before");
                }
                family = (name.to_owned(), String::new(), String::new(), false);
            }
            if family.3 {
                return wrong("behind samples");
            }
            match what {
                "TYPE" if ["gauge", "counter"].contains(&value) && family.1.is_empty() => {
                    value.clone_into(&mut family.1);
                }
                "UNIT" if name.ends_with(&format!("_{value}")) => value.clone_into(&mut family.2),
                "HELP" if !value.is_empty() => {}
                _ => return wrong("wrong metadata"),
            }
            continue;
        }
        let (name, labels, value) = sample(line)?;
        let suffix = if family.1 == "counter" { "_total" } else { "" };
        if family.1.is_empty() || name != format!("{}{suffix}", family.0) {
            return wrong("a sample of another family");
        }
        if !value.is_finite() || value < 0.0 {
            return wrong("a value that it cannot have");
        }
        if samples.iter().any(|(other, of, _)| (other, of) == (&name, &labels)) {
            return wrong("a sample that was there before");
        }
        // Base units: seconds and bytes stand in the name, and nothing is in thousands of them.
        let last = family.0.rsplit('_').next().unwrap_or_default();
        if ["ns", "us", "ms", "kib", "mib", "percent", "total"].contains(&last)
            || ["seconds", "bytes"].contains(&last) == family.2.is_empty()
        {
            return wrong("no base unit");
        }
        family.3 = true;
        samples.push((name, labels, value));
    }
    Ok(samples)
}

#[test]
fn the_checker_notices_mistakes() {
    let good = "# TYPE a_seconds counter\n# UNIT a_seconds seconds\n# HELP a_seconds Text.\n\
                a_seconds_total{x=\"1\",y=\"a\\\"b\"} 1.5\na_seconds_total{x=\"2\"} 0\n# TYPE b gauge\nb 7\n# EOF\n";
    assert_eq!(openmetrics(good).unwrap().len(), 3);
    assert_eq!(openmetrics(good).unwrap()[0].1["y"], "a\"b");
    for (part, instead) in [
        ("# EOF\n", ""),
        ("a_seconds_total{x=\"1\"", "a_seconds{x=\"1\""),
        ("# UNIT a_seconds seconds\n", ""),
        ("# UNIT a_seconds seconds", "# UNIT a_seconds bytes"),
        ("x=\"2\"", "x=\"1\",y=\"a\\\"b\""),
        ("x=\"2\"", "x=\"2"),
        ("x=\"2\"", "2=\"2\""),
        ("a\\\"b", "a\\xb"),
        ("} 0", "} -1"),
        ("} 0", "} NaN"),
        ("} 0", "}0"),
        ("# TYPE b gauge\n", ""),
        ("# TYPE b gauge", "# TYPE b number"),
        ("# TYPE b gauge", "# TYPE a_seconds counter"),
        ("b 7\n", "b 7\n# HELP b Too late.\n"),
    ] {
        assert!(good.contains(part), "{part}");
        let wrong = good.replacen(part, instead, 1);
        assert!(openmetrics(&wrong).is_err(), "{wrong}");
    }
}

/// A daemon with a client that has had a frame, an edit and a refusal.
fn served(sandbox: &Sandbox, line: &str) -> (Serving, pairmask::Session) {
    let serving = Serving::start(sandbox, line, "default");
    let mut session = serving.session();
    let mut frame = session.frame(4).unwrap();
    frame.boxes_mut().fill(Aabb::from([0.0; 6]));
    frame.submit().unwrap().wait().unwrap();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    drop(scene.edit().set(0, Aabb::from([0.0; 6])).commit(Report::All).unwrap());
    drop(scene);
    (serving, session)
}

#[test]
fn metrics_are_openmetrics_and_the_dashboard_asks_for_those_that_there_are() {
    let sandbox = Sandbox::new();
    let (_serving, session) = served(&sandbox, "--gpu none --audit 1/1");
    let text = sandbox.run_line("status --metrics");
    assert_eq!(text.code, Some(0), "{text:?}");
    let samples =
        openmetrics(&text.stdout).unwrap_or_else(|wrong| panic!("{wrong}\n{}", text.stdout));
    let value = |name: &str| {
        let found = samples.iter().filter(|(of, _, _)| of == name);
        found
            .map(|(_, _, value)| *value)
            .next()
            .unwrap_or_else(|| panic!("{name}: {}", text.stdout))
    };
    assert_eq!(value("pairmask_up"), 1.0);
    assert_eq!((value("pairmask_frames_total"), value("pairmask_client_frames_total")), (2.0, 2.0));
    assert_eq!((value("pairmask_boxes_total"), value("pairmask_client_edits_total")), (5.0, 1.0));
    assert!(value("pairmask_memory_limit_bytes") > 1e6);
    let client =
        samples.iter().find(|(name, _, _)| name == "pairmask_client_frames_total").unwrap();
    assert_eq!(client.1["process"], std::process::id().to_string());
    let stages =
        samples.iter().filter(|(name, _, _)| name == "pairmask_client_stage_seconds_total");
    assert_eq!(stages.count(), 5);
    drop(session);

    let names: BTreeSet<&str> = samples.iter().map(|(name, _, _)| name.as_str()).collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("packaging/grafana/pairmask.json");
    let dashboard: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let mut queries = Vec::new();
    collect(&dashboard, &mut queries);
    assert!(queries.len() >= 20, "{queries:?}");
    for query in queries {
        let asked = asked_for(&query);
        assert!(!asked.is_empty(), "{query}");
        for name in asked {
            assert!(names.contains(name), "{name} of {query}");
        }
    }
    assert_eq!(
        asked_for("rate(pairmask_a_total{x=\"1\"}[5m]) / pairmask_b"),
        ["pairmask_a_total", "pairmask_b"]
    );
}

/// The queries of a dashboard.
fn collect(value: &Value, queries: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            let is_query = |name: &str| ["expr", "query"].contains(&name);
            queries.extend(fields.iter().filter(|(name, _)| is_query(name)).filter_map(
                |(_, value)| value.as_str().filter(|text| *text != "prometheus").map(str::to_owned),
            ));
            fields.values().for_each(|value| collect(value, queries));
        }
        Value::Array(values) => values.iter().for_each(|value| collect(value, queries)),
        _ => {}
    }
}

/// Names of our metrics in a query.
fn asked_for(query: &str) -> Vec<&str> {
    let words = query.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    words.filter(|word| word.starts_with("pairmask_")).collect()
}

#[test]
fn without_a_daemon_there_are_no_metrics() {
    let sandbox = Sandbox::new();
    let none = sandbox.run_line("status --metrics");
    assert_eq!((none.code, none.stdout.as_str()), (Some(1), "# EOF\n"));
    assert!(none.error(1).contains("pairmaskd serve"), "{none:?}");
    assert!(sandbox.run_line("status --metrics --json").error(2).contains("--json"));
}

#[test]
fn a_file_of_metrics_is_whole_at_any_time_and_goes_with_the_daemon() {
    let sandbox = Sandbox::new();
    let folder = sandbox.path().join("collector");
    std::fs::create_dir(&folder).unwrap();
    let path = folder.join("pairmask.prom");
    let line = format!("--gpu none --metrics-file {}", path.display());
    let (serving, session) = served(&sandbox, &line);
    // A worker lives before it has counters: what is read in between has only what was known then.
    let text = eventually("the counters of a worker that lives are in the file", || {
        let text = std::fs::read_to_string(&path).ok()?;
        // Replaced as a whole: it has its last metric whenever it is read.
        assert!(text.contains("pairmask_up{") && text.ends_with('\n'), "{text}");
        let is_alive = text.contains("pairmask_up{instance=\"default\"} 1\n");
        (is_alive && text.contains("pairmask_frames_total{")).then_some(text)
    });
    // The older format has counters with their suffix, and no units.
    assert!(text.contains("# TYPE pairmask_frames_total counter\n"), "{text}");
    assert!(!text.contains("# UNIT") && !text.contains("# EOF"), "{text}");
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        sample(line).unwrap();
    }
    let mode =
        std::os::unix::fs::PermissionsExt::mode(&std::fs::metadata(&path).unwrap().permissions());
    assert_eq!(mode & 0o777, 0o644);
    drop(session);
    serving.stop(Signal::TERM);
    assert_eq!(
        std::fs::read_dir(&folder).unwrap().count(),
        0,
        "old numbers would be taken for new"
    );
}
