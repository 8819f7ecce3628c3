//! The header is what cbindgen makes of this crate.

use std::path::{Path, PathBuf};

fn here() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The header as it should be.
fn generated(root: &Path) -> String {
    let head = std::fs::read_to_string(root.join("HEADER.h")).expect("the head of the header");
    let config = cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("cbindgen.toml");
    let config = cbindgen::Config { header: Some(head.trim_end().to_owned()), ..config };
    let made = cbindgen::Builder::new().with_crate(root).with_config(config).generate();
    let mut bytes = Vec::new();
    made.expect("a header").write(&mut bytes);
    String::from_utf8(bytes).expect("a text")
}

#[test]
fn the_header_is_generated() {
    let there = std::fs::read_to_string(here().join("include/pairmask.h")).expect("the header");
    let differs = "include/pairmask.h is not what the sources make: cargo test -p pairmask-c --lib -- --ignored";
    assert!(there == generated(&here()), "{differs}");
    for name in ["pm_session_connect", "PM_ERR_HANDLE", "pm_scene_lease", "} pm_answer;"] {
        assert!(there.contains(name), "{name}");
    }
}

/// Writes the header: for who changes the sources.
#[test]
#[ignore = "writes include/pairmask.h: cargo test -p pairmask-c --lib -- --ignored"]
fn write_the_header() {
    let path = here().join("include/pairmask.h");
    std::fs::write(path, generated(&here())).expect("written");
}
