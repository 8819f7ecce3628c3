//! Bounding spheres: what the all-pairs test costs, and what plain f32 gets wrong.
//!
//! Source: N. Mohd Suaib, F. Mohd Nasir, "Broad phase collision detection using graphics processing
//! unit", 2015: all pairs of bounding spheres, sequential against parallel (table 1). The paper's
//! parallel version ran on a GPU; here it is the CPU's threads, so its speed-up is a bound of what is
//! gained, not the same experiment.
//!
//! The parts: [`oracle`] decides pairs in integers of any size; [`families`] makes pairs that are
//! hard to decide; [`errors`] counts what ways to decide get wrong on them; [`speed`] times frames;
//! [`paper`] holds the paper's table; [`report`] writes all of it down.

pub mod errors;
pub mod families;
pub mod oracle;
pub mod paper;
pub mod report;
pub mod speed;

pub use errors::{ErrorRow, count_errors};
pub use report::SphereReport;

use super::machine::Machine;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SphereOptions {
    /// Time frames.
    pub speed: bool,
    /// Count errors on so many random pairs, and a hundredth of them tangent; 0 for none.
    pub pairs: u64,
    /// Few spheres and few runs: seconds, for a look. Times mean little.
    pub quick: bool,
    /// Seed of scenes and pairs.
    pub seed: u64,
}

/// Measures. `watch` is told how many more pairs of the errors are decided, of
/// [`errors::pairs_decided`] in all.
pub fn measure(options: &SphereOptions, watch: impl Fn(u64) + Sync) -> SphereReport {
    let speed =
        if options.speed { speed::measure(options.quick, options.seed) } else { Vec::new() };
    let errors = if options.pairs > 0 {
        errors::measure(options.pairs, options.seed, watch)
    } else {
        Vec::new()
    };
    SphereReport { machine: Machine::here(None), speed, errors }
}
