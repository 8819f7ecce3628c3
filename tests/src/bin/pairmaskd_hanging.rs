//! A daemon whose lanes wait for ever in each answer that has pairs: tests check that such a worker is replaced.

use pairmask_core::engine::CullReport;

fn hang(_: &mut [u32], report: &mut CullReport) {
    if report.pair_count > 0 {
        loop {
            std::thread::park();
        }
    }
}

fn main() -> std::process::ExitCode {
    pairmaskd::cli::main_altering(hang)
}
