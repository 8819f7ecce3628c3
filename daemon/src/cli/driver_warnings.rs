//! What drivers would print on the user's terminal.

/// Mesa's layer that sorts adapters asks the user's display which one it runs on, and complains on
/// stderr where there is none to ask (`XDG_RUNTIME_DIR is invalid or not set`). Users choose by
/// `--gpu`, and the daemon's worker is started with the same variable: a number in `--gpu` means the
/// same adapter in every command.
const NO_SORTING_LAYER: &str = "NODEVICE_SELECT";

/// Switches that layer off for this process and those that it starts, unless the user decided. Call
/// it first: where the process has other threads already, nothing is changed.
#[allow(unsafe_code)]
pub fn silence() {
    if std::env::var_os(NO_SORTING_LAYER).is_some() || !is_single_threaded() {
        return;
    }
    // SAFETY: the environment may be changed while no other thread can read it. The kernel lists one
    // thread for this process, which is the one that runs here, so that no other can start meanwhile.
    unsafe { std::env::set_var(NO_SORTING_LAYER, "1") };
}

fn is_single_threaded() -> bool {
    std::fs::read_dir("/proc/self/task").is_ok_and(|threads| threads.count() == 1)
}

#[cfg(test)]
mod tests {
    use super::is_single_threaded;

    #[test]
    fn a_process_with_more_threads_is_left_alone() {
        // The test harness runs this in a thread of its own.
        assert!(!is_single_threaded());
    }
}
