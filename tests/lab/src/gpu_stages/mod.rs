//! Memory that is shared as the daemon's is, for engines of the GPU, and times of persistent scenes. Pairs are
//! compared with those of the CPU.

pub(crate) mod scenes;
pub(crate) mod shared;

use pairmaskd::scene::SceneName;

use crate::Fault;

pub(crate) fn wrong_pairs(n: u32, scene: SceneName) -> Fault {
    format!("{n} boxes of {scene}: the pairs differ from the CPU's").into()
}
