//! Engines of the GPU in memory that is shared as the daemon's is: times of stages by the GPU's clock, and of frames
//! by the host's. Pairs are compared with those of the CPU.

pub(crate) mod grid;
pub(crate) mod scenes;
pub(crate) mod shared;

use pairmaskd::scene::SceneName;

use crate::Fault;

fn wrong_pairs(n: u32, scene: SceneName) -> Fault {
    format!("{n} boxes of {scene}: the pairs differ from the CPU's").into()
}
