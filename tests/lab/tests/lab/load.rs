//! `load`: its JSON, and that clients keep their pace.

use serde_json::Value;

use super::support::{Sandbox, keys, names};

/// Runs a load for a second, and returns its report.
fn load(sandbox: &Sandbox, flags: &str) -> Value {
    sandbox.run_line(&format!("load --seconds 1 --json {flags}")).json()
}

fn rows(report: &Value) -> &Vec<Value> {
    report["rows"].as_array().unwrap()
}

/// The rows' rates, sizes and clients, of those that ran at a time.
fn settings(report: &Value) -> Vec<(&str, u64, u64, u64)> {
    let number = |row: &Value, name: &str| row[name].as_u64().unwrap();
    let setting = |row| {
        let clients = (number(row, "clients"), number(row, "clients_in_all"));
        (row["rate"].as_str().unwrap(), number(row, "n"), clients.0, clients.1)
    };
    rows(report).iter().map(setting).collect()
}

#[test]
fn a_paced_client_has_a_row_for_every_rate_and_size() {
    let sandbox = Sandbox::new();
    let report = load(&sandbox, "--rate closed,50,200 --n 0,100");
    let rates = ["closed", "50", "200"].into_iter();
    let expected: Vec<_> = rates.flat_map(|rate| [0, 100].map(|n| (rate, n, 1, 1))).collect();
    assert_eq!(settings(&report), expected);
    for row in rows(&report) {
        assert_eq!((&row["backend"], &row["wait"]), (&"daemon".into(), &"serve".into()));
        assert!(row["daemon_cpu_percent"].is_number() && row["total_ns"]["p50"].is_number());
        let due = &row["from_due_ns"];
        assert_eq!(keys(due), names("p50 p90 p99 p999 max"));
        let frames = row["frames"].as_u64().unwrap();
        if row["rate"] == "closed" {
            assert_eq!((&due["max"], &row["late_frames"]), (&0.into(), &0.into()), "{row}");
            assert!(frames > 0, "{row}");
        } else {
            // An open loop leaves no frame out, however slow the machine is.
            let rate: u64 = row["rate"].as_str().unwrap().parse().unwrap();
            assert_eq!(frames, rate, "{row}");
            assert!(due["max"].as_u64() >= row["total_ns"]["max"].as_u64(), "{row}");
        }
    }
    let idle = &report["idle"][0];
    assert_eq!(keys(idle), names("wait clients daemon_cpu_percent"));
    assert_eq!((&idle["wait"], &idle["clients"]), (&"serve".into(), &1.into()));
    sandbox.assert_clean(&[]);
}

#[test]
fn clients_are_counted_together_and_of_differing_sizes_apart() {
    let sandbox = Sandbox::new();
    let report = load(&sandbox, "--clients 1,3 --n 100 --wait event");
    assert_eq!(settings(&report), [("closed", 100, 1, 1), ("closed", 100, 3, 3)]);
    for row in rows(&report) {
        assert!(row["frames_per_second"].as_f64().unwrap() > 0.0, "{row}");
        let worst = row["worst_client_p50_ns"].as_u64().unwrap();
        assert!(worst >= row["round_trip_ns"]["p50"].as_u64().unwrap() || row["clients"] == 1);
    }
    let report = load(&sandbox, "--mix 70x2,1000x1 --rate 100");
    assert_eq!(settings(&report), [("100", 70, 2, 3), ("100", 1000, 1, 3)]);
    let frames: Vec<u64> = rows(&report).iter().map(|r| r["frames"].as_u64().unwrap()).collect();
    assert_eq!(frames, [200, 100]);
    let report = load(&sandbox, "--rate 100 --n 70 --backend in-process");
    assert_eq!(rows(&report)[0]["backend"], "in-process");
    assert!(rows(&report)[0]["daemon_cpu_percent"].is_null() && report.get("idle").is_none());
    sandbox.assert_clean(&[]);
}

#[test]
fn the_text_says_who_asked_and_clients_that_cannot_connect_are_reported_of_once() {
    let sandbox = Sandbox::new();
    let finished =
        sandbox.run(&["load", "--seconds", "1", "--rate", "50", "--n", "70", "--out", "load"]);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(sandbox.file("load/load.csv").is_file());
    for part in
        ["| rate ", "| 50 ", " from_due_ns.p99 ", "## Clients that send nothing", "| serve "]
    {
        assert!(finished.stdout.contains(part), "{part}: {finished:?}");
    }
    let absent = ["load", "--clients", "3", "--instance", "nobody", "--backend", "daemon"];
    let finished = sandbox.run(&absent);
    let error = finished.error(1);
    assert!(error.contains("a client process failed: ") && error.contains("nobody"), "{error}");
}
