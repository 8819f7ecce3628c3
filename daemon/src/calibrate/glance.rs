//! A look at the machine when a daemon starts.

use std::time::Duration;

use pairmask::plan::Calibration;

use super::case::{Case, Effort, WaySet, measure};
use super::threads::Pools;
use super::{MeasureError, fit};
use crate::scene::SceneName;

/// Scenes that are timed: one where all pairs are compared, one where the grid is at home.
const CASES: [Case; 2] =
    [Case { scene: SceneName::Uniform, n: 512 }, Case { scene: SceneName::Uniform, n: 4_096 }];
/// 15 ms in all on a machine like that of the built-in constants.
const EFFORT: Effort = Effort { least_frames: 5, most_frames: 20, time: Duration::from_millis(5) };

/// The constants of `start` scaled to this machine: each engine by itself, one thread. Shapes of
/// scenes and the gain of threads are left to `pairmaskd calibrate`.
///
/// A CPU that is twice as slow as that of the built-in constants would otherwise take frames away
/// from a GPU that is faster.
///
/// # Errors
/// [`MeasureError`].
pub fn glance(start: &Calibration) -> Result<Calibration, MeasureError> {
    let pools = Pools::new(&[])?;
    let cases = CASES.map(|case| measure(case, WaySet::Sparse, &[1], &pools, &EFFORT));
    let cases = cases.into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok(fit::scale(&fit::rows(&cases), start))
}
