//! Errors of the commands, and their exit status.

use super::bench::BenchError;
use super::config::ConfigError;
use super::cull::CullCommandError;
use super::demo::DemoError;
use super::explain::ExplainCommandError;
use super::output::OutputError;
use super::program::{FAILED, Failure, USAGE, WrongUsage, says_why};
use super::scene::SceneCommandError;
use super::status::StatusCommandError;
use crate::serve::ServeError;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The command line is wrong.
    #[error(transparent)]
    Usage(#[from] WrongUsage),
    /// Help or version could not be printed.
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
    Scene(#[from] SceneCommandError),
    #[error(transparent)]
    Status(#[from] StatusCommandError),
    #[error(transparent)]
    Explain(#[from] ExplainCommandError),
}

impl Failure for CliError {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Config(_) => USAGE,
            Self::Bench(error) if error.is_usage() => USAGE,
            Self::Cull(error) if error.is_usage() => USAGE,
            _ => FAILED,
        }
    }

    fn was_said(&self) -> bool {
        says_why(match self {
            Self::Serve(ServeError::Worker { code }) => Some(*code),
            Self::Demo(DemoError::Client { status }) => status.code(),
            Self::Cull(CullCommandError::Spawn(error))
            | Self::Demo(DemoError::Spawn(error))
            | Self::Bench(BenchError::Spawn(error)) => error.exit_code(),
            _ => None,
        })
    }
}
