//! `soak`: clients that come and go, samples, and that the exit status is what the report says.

use serde_json::Value;

use super::support::{Sandbox, keys, names};

const FIELDS: &str = "machine stress left probe restarts quantities samples";
const SAMPLE: &str = "at_ns worker_pid anonymous_bytes shared_bytes descriptors mappings threads shm_used_bytes \
    shm_files probe_frames probe_lost probe_p50_ns probe_p99_ns daemon_cpu_percent";
const QUANTITIES: &str = "anonymous_bytes shared_bytes descriptors mappings threads shm_used_bytes shm_files \
    probe_p50_ns probe_p99_ns";

#[test]
fn clients_come_and_go_and_the_worker_is_watched() {
    let sandbox = Sandbox::new();
    // With this seed a client is killed and others are asked to end in that time.
    let line = "soak --seconds 24 --interval 2 --clients 4 --seed 1 --gpu none --json --out .";
    let finished = sandbox.run_line(line);
    let report: Value = serde_json::from_str(&finished.stdout).unwrap();
    assert_eq!(keys(&report), names(FIELDS));

    let clients = &report["stress"]["clients"];
    let count = |value: &Value| value.as_u64().unwrap();
    assert_eq!(report["stress"]["failures"], Value::Array(vec![]), "{finished:?}");
    assert!(count(&report["stress"]["answers"]) > 100, "{report}");
    assert!(count(&clients["edits"]) > 0 && count(&clients["queries"]) > 0, "{report}");
    assert!(count(&clients["killed"]) > 0 && count(&report["left"]) > 0, "{report}");
    assert_eq!((&clients["broken"], &report["restarts"]), (&Value::Array(vec![]), &0.into()));
    assert!(count(&report["probe"]["frames"]) > 100 && report["probe"]["lost"] == 0, "{report}");

    let samples = report["samples"].as_array().unwrap();
    // A busy machine may be late for some.
    assert!((8..=12).contains(&samples.len()), "{}", samples.len());
    for sample in samples {
        assert_eq!(keys(sample), names(SAMPLE));
        let all = names(SAMPLE);
        let read = all.iter().filter(|name| **name != "daemon_cpu_percent");
        read.for_each(|name| assert!(sample[*name].is_u64(), "{name}: {sample}"));
        assert_eq!(sample["worker_pid"], samples[0]["worker_pid"]);
    }

    // Half a minute is too short for every quantity to be flat: but the exit status is what the verdicts say.
    let quantities = report["quantities"].as_array().unwrap();
    let named = quantities.iter().map(|row| row["quantity"].as_str().unwrap()).collect();
    assert_eq!(names(QUANTITIES), named);
    let is_flat = quantities.iter().all(|row| row["verdict"] == "flat");
    assert_eq!(finished.code, Some(i32::from(!is_flat)), "{finished:?}");
    assert_eq!(finished.stderr.contains("grew"), !is_flat, "{finished:?}");
    // Without a terminal a line now and then says how it goes.
    assert!(finished.stderr.contains("MiB anonymous"), "{finished:?}");
    sandbox.assert_clean(&["soak.csv", "soak.json", "soak.md"]);
}
