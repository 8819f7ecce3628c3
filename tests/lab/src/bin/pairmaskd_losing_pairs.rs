//! The daemon, except that it loses a pair of most frames: tests hold its auditor to noticing.

fn main() -> std::process::ExitCode {
    pairmaskd::cli::main_altering(pairmask_lab::sabotage::lose_a_pair)
}
