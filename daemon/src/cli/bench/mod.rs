//! `bench`: what frames cost on this machine.

mod closed_loop;
mod grid;
mod latency;
mod machine;
mod mapping;
mod pin;
mod report;

use clap::{Args, Subcommand};

pub use self::latency::BenchError;
use super::config::Config;
use super::options::Place;

/// Measure what frames cost on this machine
#[derive(Debug, Args)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Latency(latency::Latency),
    Mapping(mapping::Mapping),
    Grid(grid::Grid),
}

impl Bench {
    /// Measures.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        match &self.what {
            What::Latency(latency) => latency.run(place, config),
            What::Mapping(mapping) => mapping.run(config),
            What::Grid(grid) => grid.run(config),
        }
    }
}
