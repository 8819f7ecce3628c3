//! `pairmask-lab`, and the daemon that loses pairs, as the tests run them.

use pairmask_tests::command_line::{self, Program};

pub use pairmask_tests::command_line::{Finished, keys, names};

pub struct PairmaskLab;

impl Program for PairmaskLab {
    const BINARY: &str = env!("CARGO_BIN_EXE_pairmask-lab");
    const NAME: &str = "pairmask-lab";
}

pub type Sandbox = command_line::Sandbox<PairmaskLab>;

pub struct LosingDaemon;

impl Program for LosingDaemon {
    const BINARY: &str = env!("CARGO_BIN_EXE_pairmaskd_losing_pairs");
    const NAME: &str = "pairmaskd";
}
