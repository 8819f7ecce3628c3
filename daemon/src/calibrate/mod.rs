//! The constants of the plan's cost model, measured on this machine.
//!
//! Cases (a scene of some size) are culled in every way that is worth its time ([`measure`]); a fit
//! gives the constants from the times ([`fit`]). `pairmaskd calibrate` does all of it, a daemon that
//! starts takes a short look ([`glance`]).

mod case;
mod fit;
mod glance;
mod lane;
mod threads;

pub use case::{Case, CaseTimes, Effort, WaySet, measure};
pub use fit::{FitRow, fit, rows, scale};
pub use glance::glance;
pub use lane::{LaneTimes, Way};
pub use threads::{Pools, core_count, thread_counts};

use pairmask::engine::{CullError, EngineName};
use pairmask::mask::MaskError;

use crate::scene::SceneName;

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// An engine gave no mask.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// No threads.
    #[error("the engines' threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// An engine is broken: its mask is none.
    #[error("a mask cannot be read: {0}: please report this")]
    Mask(#[from] MaskError),
    /// An engine is broken: the number that it gives is not that of the bits that it set.
    #[error("{engine} counted {counted} pairs and its mask holds {decoded}: please report this")]
    Miscounted {
        /// The engine.
        engine: EngineName,
        /// What it says.
        counted: u64,
        /// What it wrote.
        decoded: u64,
    },
    /// An engine is broken: another finds other pairs.
    #[error(
        "{first} finds {pairs} pairs in {n} boxes of {scene} and {second} {other}: please report this"
    )]
    Disagree {
        /// Which scene.
        scene: SceneName,
        /// Boxes.
        n: usize,
        /// One engine.
        first: EngineName,
        /// Its pairs.
        pairs: u64,
        /// The other.
        second: EngineName,
        /// Its pairs.
        other: u64,
    },
}
