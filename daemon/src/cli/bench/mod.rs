//! `bench`: what frames cost on this machine.

mod latency;
mod measured;
mod pin;
mod report;

use clap::{Args, Subcommand};

pub use self::latency::{BenchError, SEED, Wait, threads_of};
pub use self::measured::Figures;
pub use self::report::LatencyRow;
use super::config::Config;
use super::options::Place;

/// Measure what frames cost on this machine
#[derive(Debug, Args)]
#[command(
    after_help = "Engines, precision modes, clients at a pace and pair numberings are measured by `pairmask-lab` (tests/lab)."
)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Latency(latency::Latency),
}

impl Bench {
    /// Measures.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        match &self.what {
            What::Latency(latency) => latency.run(place, config),
        }
    }
}
