//! A short measurement of the machine when a daemon starts.

use std::time::Duration;

use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::Calibration;

use super::case::{Case, Effort, WaySet, measure};
use super::threads::Pools;
use super::{MeasureError, fit};
use crate::scene::SceneName;

/// Scenes that are timed: one small enough to compare all pairs, one that suits the grid.
const CASES: [Case; 2] =
    [Case { scene: SceneName::Uniform, n: 512 }, Case { scene: SceneName::Uniform, n: 4_096 }];
/// Limits of a case; 15 ms in all on the machine of the built-in constants.
const EFFORT: Effort = Effort { least_frames: 5, most_frames: 20, time: Duration::from_millis(5) };

/// The constants of `start` scaled to this machine and `isa`: each engine by itself, one thread. `pairmaskd
/// calibrate` measures shapes of scenes and the gain of threads.
///
/// Without it, the plan would give frames to a CPU twice as slow as that of the built-in constants
/// where the GPU is faster.
///
/// # Errors
/// [`MeasureError`].
pub fn glance(start: &Calibration, isa: AvailableIsa) -> Result<Calibration, MeasureError> {
    let pools = Pools::new(&[])?;
    let cases = CASES.map(|case| measure(case, WaySet::Sparse, &[1], &pools, &EFFORT, isa));
    let cases = cases.into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok(fit::scale(&fit::rows(&cases), start))
}
