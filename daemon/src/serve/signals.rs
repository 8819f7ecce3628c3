//! The signals by which a daemon stops in order.

use std::ffi::c_int;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// Ctrl-C, what supervisors of services send, and the end of a terminal. `nohup` has the last one ignored, which stays so.
pub(super) fn stop_signals() -> impl Iterator<Item = c_int> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = ignored_signals(&status);
    [SIGINT, SIGTERM].into_iter().chain((ignored & bit(SIGHUP) == 0).then_some(SIGHUP))
}

/// The set of signals that a process ignores, by its status in /proc; none where that is not known.
fn ignored_signals(status: &str) -> u64 {
    let set = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    set.and_then(|set| u64::from_str_radix(set.trim(), 16).ok()).unwrap_or(0)
}

/// The bit of a signal in a set: they count from 1.
const fn bit(signal: c_int) -> u64 {
    1 << (signal - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_status() {
        let status = |set: &str| format!("SigBlk:\tffff\nSigIgn:\t{set}\nSigCgt:\tffff\n");
        for (text, is_ignored) in [
            (status("0000000000000001"), true),
            (status("0000000000001001"), true),
            (status("0000000000001000"), false),
            (status("none"), false),
            (String::new(), false),
        ] {
            assert_eq!(ignored_signals(&text) & bit(SIGHUP) != 0, is_ignored, "{text}");
        }
    }
}
