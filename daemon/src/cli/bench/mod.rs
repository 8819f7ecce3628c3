//! `bench`: what frames cost on this machine.

mod closed_loop;
mod latency;
mod load;
mod measured;
mod pin;
mod report;

use clap::{Args, Subcommand};

pub use self::latency::BenchError;
pub use self::load::BenchClient;
use super::config::Config;
use super::options::Place;

/// Measure what frames cost on this machine
#[derive(Debug, Args)]
#[command(
    after_help = "Engines, precision modes and pair numberings are measured by `pairmask-lab` (tests/lab)."
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
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        match &self.what {
            What::Latency(latency) => latency.run(place, config),
        }
    }
}
