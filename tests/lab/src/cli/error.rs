//! Errors of measurements, and their exit status.

use crate::study::ways::MeasureError;
use pairmaskd::cli::config::ConfigError;
use pairmaskd::cli::output::OutputError;
use pairmaskd::cli::program::{FAILED, Failure, USAGE, WrongUsage, says_why};
use pairmaskd::serve::ServeError;

use super::load::LoadError;
use super::stress::StressCommandError;
use crate::gpu_stages::BenchError;
use crate::study::harness::StudyError;

/// Why a measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// The command line is wrong.
    #[error(transparent)]
    Usage(#[from] WrongUsage),
    /// A result, help or the version could not be printed.
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Stress(#[from] StressCommandError),
    #[error(transparent)]
    Load(#[from] LoadError),
    #[error(transparent)]
    Study(#[from] StudyError),
    #[error(transparent)]
    Stages(#[from] BenchError),
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// The daemon of a measurement did not start.
    #[error(transparent)]
    Serve(#[from] ServeError),
}

impl Failure for LabError {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) | Self::Config(_) | Self::Load(LoadError::Asked(_)) => USAGE,
            _ => FAILED,
        }
    }

    fn was_said(&self) -> bool {
        says_why(match self {
            Self::Serve(ServeError::Worker { code }) => Some(*code),
            Self::Study(StudyError::Spawn(error))
            | Self::Load(LoadError::Spawn(error))
            | Self::Stress(StressCommandError::Spawn(error)) => error.exit_code(),
            _ => None,
        })
    }
}
