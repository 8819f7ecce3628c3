//! `gpus`: what `--gpu` can name.

use serde_json::Value;

use crate::support::{Sandbox, keys, names, run_with};

/// The tests' machines have a software adapter at least.
#[test]
fn adapters_are_listed_by_the_numbers_that_gpu_takes() {
    let sandbox = Sandbox::new();
    let report = sandbox.run_line("gpus --json").json();
    let gpus = report["gpus"].as_array().unwrap();
    assert!(!gpus.is_empty());
    let fields =
        "number name kind driver backend pci_address memory_bytes imports_host_memory auto";
    for (at, gpu) in gpus.iter().enumerate() {
        assert_eq!(keys(gpu), names(fields));
        assert_eq!((&gpu["number"], &gpu["backend"]), (&at.into(), &"vulkan".into()));
        let is_software = gpu["kind"] == "software";
        assert!(!is_software || gpu["memory_bytes"].is_null() && gpu["auto"] == false, "{gpu}");
    }
    assert!(gpus.iter().any(|gpu| gpu["kind"] == "software"), "{report}");
    let text = sandbox.run_line("gpus").stdout;
    for gpu in gpus {
        let [number, name, kind] =
            ["number", "name", "kind"].map(|key| gpu[key].to_string().replace('"', ""));
        assert!(text.contains(&format!("{number}: {name}, {kind}")), "{text}");
    }
}

#[test]
fn without_a_driver_none_is_listed() {
    let sandbox = Sandbox::new();
    let no_driver = [("VK_DRIVER_FILES", "/dev/null"), ("VK_ICD_FILENAMES", "/dev/null")];
    let report = run_with(&sandbox, "gpus --json", &no_driver).json();
    assert_eq!(report["gpus"], Value::Array(vec![]));
    let text = run_with(&sandbox, "gpus", &no_driver).stdout;
    assert!(text.contains("no GPU: is a Vulkan driver installed?"), "{text}");
}
