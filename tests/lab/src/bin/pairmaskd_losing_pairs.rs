//! A daemon that loses a pair of most frames: tests check that its auditor notices.

fn main() -> std::process::ExitCode {
    pairmaskd::cli::main_altering(pairmask_lab::sabotage::lose_a_pair)
}
