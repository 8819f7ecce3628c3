//! What a client process and its parent tell each other, a line of JSON each.

use std::io;

use serde::{Deserialize, Serialize};

use crate::cli::bench::latency::BenchError;
use crate::cli::bench::measured::Figures;

/// A line from a client.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Said {
    /// It is connected, and waits for the start.
    Ready,
    /// What it measured.
    Done(Box<Figures>),
    /// It could not measure, and why.
    Failed(String),
}

/// The line by which the parent starts a client.
pub(super) const START: &str = "start\n";

/// The two processes cannot talk to each other.
pub(super) fn lost(error: impl Into<io::Error>) -> BenchError {
    BenchError::Clients { source: error.into() }
}
