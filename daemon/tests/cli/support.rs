//! `pairmaskd`, as the tests run it.

use std::path::Path;
use std::process::Child;

use pairmask_tests::command_line::{self, Program};
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::spawn::{PrivateDaemon, PrivateSettings};

pub use pairmask_tests::command_line::{Finished, eventually, keys, names};
pub use pairmask_tests::daemon::stop;

pub const PAIRMASKD: &str = env!("CARGO_BIN_EXE_pairmaskd");

/// The binary.
pub struct Pairmaskd;

impl Program for Pairmaskd {
    const BINARY: &str = PAIRMASKD;
    const NAME: &str = "pairmaskd";
}

/// A directory for one test of the binary.
pub type Place = command_line::Place<Pairmaskd>;

/// Waits for the end of a process, and kills it where it hangs.
pub fn finish(child: Child) -> Finished {
    command_line::finish(child, Pairmaskd::NAME)
}

/// A daemon of the test's own.
pub fn daemon() -> PrivateDaemon {
    let settings = PrivateSettings { gpu: GpuChoice::None.into(), ..PrivateSettings::default() };
    PrivateDaemon::start(PAIRMASKD.as_ref(), &settings).unwrap()
}

/// Runs the binary with the words of a line.
pub fn run(place: &Place, line: &str) -> Finished {
    place.run_line(line)
}

/// The same with variables.
pub fn run_with(place: &Place, line: &str, variables: &[(&str, &str)]) -> Finished {
    let mut command = place.command(&line.split_whitespace().collect::<Vec<_>>());
    finish(command.envs(variables.iter().copied()).spawn().unwrap())
}

/// u32 words of a file.
pub fn words(path: &Path) -> Vec<u32> {
    let bytes = std::fs::read(path).unwrap();
    assert!(bytes.len().is_multiple_of(4), "{} bytes", bytes.len());
    bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}
