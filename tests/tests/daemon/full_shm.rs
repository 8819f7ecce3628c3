//! Clients whose daemon's shared memory is full, or nearly so.

use std::process::Command;

use pairmask_tests::attack_time;
use pairmask_tests::daemon::{pairmaskd, program};

/// Nightly runs try every number of free pages, others every eighth.
fn step_bytes() -> u64 {
    if attack_time().as_secs() >= 60 { 4096 } else { 8 * 4096 }
}

/// More bytes than connecting and a frame take.
const MOST_BYTES: u64 = 512 << 10;

/// Runs commands, which set `code`, beside a daemon in a namespace with so many megabytes of shared memory of its own.
/// Returns what they print.
fn beside_daemon(megabytes: u32, commands: &str) -> String {
    let dir = tempfile::tempdir().unwrap();
    let script = format!(
        "mount -t tmpfs -o size={megabytes}m tmpfs /dev/shm || exit; \
         {} serve --gpu none & daemon=$!; cd {}; \
         for i in $(seq 300); do [ -e default.daemon ] && break; sleep 0.05; done; \
         {commands}; kill $daemon; wait; exit $code",
        pairmaskd().display(),
        dir.path().display(),
    );
    let output = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "bash", "-c", &script])
        .env("PAIRMASK_RUNTIME_DIR", dir.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    said.into_owned()
}

#[test]
fn a_full_shm_is_a_typed_error_and_no_death() {
    let client = program("fault_client");
    for mode in ["full", "full-spheres"] {
        let said = beside_daemon(2, &format!("{} {mode}; code=$?", client.display()));
        assert!(said.contains("no shared memory for"), "{mode}: {said}");
    }
}

/// In the end there is room again, and the same worker serves.
#[test]
fn connecting_to_a_full_shm_succeeds_or_is_a_typed_error_and_kills_no_process() {
    let commands = format!(
        "before=$(head -1 default.daemon); \
         {client} {step} {MOST_BYTES}; code=$?; {client} daemon; \
         [ \"$before\" = \"$(head -1 default.daemon)\" ] && echo same worker",
        client = program("squeezed_client").display(),
        step = step_bytes(),
    );
    let said = beside_daemon(8, &commands);
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(&lines[1..], ["served", "same worker"], "{said}");
    // Every outcome has to occur, else the free sizes were chosen wrongly.
    for none in ["served 0,", "refused 0,", "process 0"] {
        assert!(!lines[0].contains(none), "{said}");
    }
}
