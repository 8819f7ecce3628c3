//! `bench`: what frames cost on this machine.

mod accuracy;
mod closed_loop;
mod grid;
mod latency;
mod machine;
mod mapping;
mod pin;
mod plan;
mod replies;
mod report;
mod scenes;
mod spheres;
mod target;
mod threads;

use clap::{Args, Subcommand};

pub use self::latency::BenchError;
pub use self::machine::Machine;
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
    Accuracy(accuracy::Accuracy),
    Latency(latency::Latency),
    Mapping(mapping::Mapping),
    Grid(grid::Grid),
    Plan(plan::PlanBench),
    Replies(replies::Replies),
    Threads(threads::ThreadsBench),
    Spheres(spheres::Spheres),
}

impl Bench {
    /// Whether a setting of the configuration file means something for it.
    pub const fn reads_config(&self) -> bool {
        !matches!(self.what, What::Threads(_) | What::Spheres(_))
    }

    /// Measures.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        match &self.what {
            What::Accuracy(accuracy) => Ok(accuracy.run(place, config)?),
            What::Latency(latency) => latency.run(place, config),
            What::Mapping(mapping) => mapping.run(config),
            What::Grid(grid) => grid.run(config),
            What::Plan(plan) => plan.run(place, config),
            What::Replies(replies) => replies.run(place, config),
            What::Threads(threads) => threads.run(),
            What::Spheres(spheres) => spheres.run(),
        }
    }
}
