//! What the CPU engines take on this machine: measured, fitted into the plan's constants, judged.

mod case;
mod fit;
mod glance;
mod judge;
mod lane;
mod updates;

pub use case::{Case, CaseTimes, Effort, Pools, WaySet, measure};
pub use fit::{Row, fit, rows, scale};
pub use glance::glance;
pub use judge::{Judgement, judge};
pub use lane::{LaneTimes, Way};
pub use updates::update_times;

use pairmask::engine::{CullError, EngineName};
use pairmask::mask::MaskError;
use pairmask::update::UpdateError;

use crate::scene::SceneName;

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum EngineStudyError {
    /// An engine gave no mask.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// No threads.
    #[error("the engines' threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// Boxes and transforms do not belong together.
    #[error(transparent)]
    Update(#[from] UpdateError),
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
