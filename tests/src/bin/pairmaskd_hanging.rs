//! A daemon whose lanes wait for ever in each answer that has pairs, and whose worker waits for ever before it
//! serves where its directory has a file `hang`, which it removes: tests check that such workers are replaced. A
//! worker that begins where there is a file `wrong` removes that, and answers without waiting and without pairs; and one
//! that begins where there is a file `fit` answers as it should.

use std::path::PathBuf;

use pairmask_core::engine::CullReport;

fn wait_for_ever() -> ! {
    loop {
        std::thread::park();
    }
}

fn lose(words: &mut [u32], _: &mut CullReport) {
    words.fill(0);
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
    if is_worker && std::fs::remove_file(dir.join("wrong")).is_ok() {
        return pairmaskd::cli::main_altering(lose);
    }
    if dir.join("fit").exists() {
        return pairmaskd::cli::main();
    }
    pairmaskd::cli::main_altering(hang)
}
