//! Clients that connect while shared memory is full, or nearly so.

use std::process::Command;

use pairmask_tests::attack_time;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const CLIENT: &str = env!("CARGO_BIN_EXE_squeezed_client");

/// Nightly runs try every number of free pages, others every eighth.
fn step_bytes() -> u64 {
    if attack_time().as_secs() >= 60 { 4096 } else { 8 * 4096 }
}

/// More bytes than connecting and a frame take.
const MOST_BYTES: u64 = 512 << 10;

#[test]
fn connecting_to_a_full_shm_succeeds_or_is_a_typed_error_and_kills_no_process() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().display();
    // A namespace of its own with 8 MB of shared memory: daemon and clients in one. In the end there
    // is room again, and the same worker serves.
    let script = format!(
        "mount -t tmpfs -o size=8m tmpfs /dev/shm || exit; \
         {DAEMON} serve --gpu none & daemon=$!; \
         for i in $(seq 300); do [ -e {path}/default.daemon ] && break; sleep 0.05; done; \
         before=$(head -1 {path}/default.daemon); \
         {CLIENT} {step} {MOST_BYTES}; code=$?; {CLIENT} daemon; \
         [ \"$before\" = \"$(head -1 {path}/default.daemon)\" ] && echo same worker; \
         kill $daemon; wait; exit $code",
        step = step_bytes(),
    );
    let output = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "bash", "-c", &script])
        .env("PAIRMASK_RUNTIME_DIR", dir.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{complaint}");
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(&lines[1..], ["served", "same worker"], "{said}{complaint}");
    // Every outcome has to occur, else the free sizes were chosen wrongly.
    for none in ["served 0,", "refused 0,", "process 0"] {
        assert!(!lines[0].contains(none), "{said}");
    }
}
