//! A daemon whose lanes wait for ever in each answer that has pairs, and whose worker waits for ever before it
//! serves where its directory has a file `hang`, which it removes: tests check that such workers are replaced.

use std::path::PathBuf;

use pairmask_core::engine::CullReport;

fn wait_for_ever() -> ! {
    loop {
        std::thread::park();
    }
}

fn hang(_: &mut [u32], report: &mut CullReport) {
    if report.pair_count > 0 {
        wait_for_ever();
    }
}

fn main() -> std::process::ExitCode {
    let dir = PathBuf::from(std::env::var_os("PAIRMASK_RUNTIME_DIR").unwrap_or_default());
    let is_worker = std::env::args().any(|argument| argument == "--worker");
    if is_worker && std::fs::remove_file(dir.join("hang")).is_ok() {
        wait_for_ever();
    }
    pairmaskd::cli::main_altering(hang)
}
