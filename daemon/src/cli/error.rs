//! Why a command failed, and the exit status that says so.

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

/// It was tried and did not work, or nobody serves.
const FAILED: u8 = 1;
/// The command line or the configuration is wrong; clap uses the same number.
const USAGE: u8 = 2;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
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
            Self::Config(_) | Self::Cull(CullCommandError::AboutBoxes { .. }) => USAGE,
            _ => FAILED,
        }
    }

    /// Whether the reader of stdout has gone (`| head`), which is no failure of ours.
    pub fn is_closed_pipe(&self) -> bool {
        match self {
            Self::Cull(CullCommandError::Output(error))
            | Self::Demo(DemoError::Output(error))
            | Self::Bench(BenchError::Output(error))
            | Self::Calibrate(CalibrateError::Output(error))
            | Self::Status(StatusCommandError::Output(error))
            | Self::Stress(StressCommandError::Output(error))
            | Self::Explain(ExplainCommandError::Output(error)) => {
                matches!(error, OutputError::Io(e) if e.kind() == std::io::ErrorKind::BrokenPipe)
            }
            _ => false,
        }
    }
}
