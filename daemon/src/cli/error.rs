//! Why a command failed, and the exit status that says so.

use std::error::Error;

use super::bench::BenchError;
use super::calibrate::CalibrateError;
use super::config::ConfigError;
use super::cull::CullCommandError;
use super::demo::DemoError;
use super::explain::ExplainCommandError;
use super::output::OutputError;
use super::scene::SceneCommandError;
use super::status::StatusCommandError;
use super::stress::StressCommandError;
use crate::serve::ServeError;
use crate::spawn::SpawnError;

/// It was tried and did not work, or nobody serves.
const FAILED: u8 = 1;
/// The command line or the configuration is wrong; clap uses the same number.
const USAGE: u8 = 2;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// In one line.
    #[error("{0}")]
    Usage(String),
    /// Help or the version was not printed.
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Serve(#[from] ServeError),
    #[error(transparent)]
    Cull(#[from] CullCommandError),
    #[error(transparent)]
    Demo(#[from] DemoError),
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    #[error(transparent)]
    Scene(#[from] SceneCommandError),
    #[error(transparent)]
    Status(#[from] StatusCommandError),
    #[error(transparent)]
    Stress(#[from] StressCommandError),
    #[error(transparent)]
    Explain(#[from] ExplainCommandError),
}

impl CliError {
    /// The exit status.
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Config(_) | Self::Bench(BenchError::PinAlone) => USAGE,
            Self::Cull(error) if error.is_usage() => USAGE,
            _ => FAILED,
        }
    }

    /// Whether a process that was started here failed and said why on the same stderr: another line
    /// would tell nothing.
    pub fn was_said(&self) -> bool {
        let code = match self {
            Self::Serve(ServeError::Worker { code }) => Some(*code),
            Self::Demo(DemoError::Client { status }) => status.code(),
            Self::Cull(CullCommandError::Spawn(error)) | Self::Demo(DemoError::Spawn(error)) => {
                code_of(error)
            }
            Self::Bench(error) => error.spawning().and_then(code_of),
            _ => None,
        };
        code.is_some_and(|code| [FAILED, USAGE].map(i32::from).contains(&code))
    }

    /// Whether the reader of a result has gone (`| head`), which is no failure of ours.
    pub fn is_closed_pipe(&self) -> bool {
        let mut cause = self.source();
        while let Some(error) = cause {
            let io = error.downcast_ref::<std::io::Error>();
            if io.is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe) {
                return true;
            }
            cause = error.source();
        }
        false
    }
}

/// The exit code of a daemon that ended by itself before it served.
fn code_of(error: &SpawnError) -> Option<i32> {
    match error {
        SpawnError::Ended { status } => status.code(),
        _ => None,
    }
}
