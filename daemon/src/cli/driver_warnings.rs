//! Keeps warnings of graphics drivers off the user's terminal.

/// Variable that switches off Mesa's layer that sorts adapters. The layer asks the display which
/// adapter it runs on, and warns on stderr where there is no display (`XDG_RUNTIME_DIR is invalid or
/// not set`). Pairmask needs no sorting: users choose by `--gpu`. The daemon's worker inherits the
/// variable, so that a number in `--gpu` means the same adapter in every command.
const NO_SORTING_LAYER: &str = "NODEVICE_SELECT";

/// Switches the layer off for this process and its children, unless the user has set the variable.
/// Call it first: it changes nothing in a process that has other threads.
#[allow(unsafe_code)]
pub fn silence() {
    if std::env::var_os(NO_SORTING_LAYER).is_some() || !is_single_threaded() {
        return;
    }
    // SAFETY: the environment may be changed while no other thread can read it. The kernel lists one
    // thread for this process, the one that runs here, so that no other can start meanwhile.
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
