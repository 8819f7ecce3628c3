//! What a scene is asked that changes nothing, in a daemon or in this process.

use std::sync::Arc;

use pairmask_core::pacing::Estimate;
use pairmask_core::scene::Scene;
use pairmask_wire::SceneId;

use crate::session::core::Core;
use crate::session::error::Error;
use crate::session::link::Link;

/// A scene that a daemon keeps.
#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub core: &'a Core,
    pub link: &'a Arc<Link>,
    pub scene: SceneId,
    /// The one that is asked. `None` asks a shared scene, as the last tick made it.
    pub revision: Option<u64>,
    pub threads: Option<usize>,
    /// Indices of its boxes are below this.
    pub index_end: u32,
    /// The last tick of which its observer knows; 0 for none.
    pub observed: u64,
}

/// A query, a cast, or what an observer asks.
pub(super) trait Question {
    type Answer;

    /// Whether it asks about nothing.
    fn is_empty(&self) -> bool;

    /// Asks a daemon.
    fn ask(&self, asked: Asked<'_>, estimate: &mut Estimate) -> Result<Self::Answer, Error>;

    /// Asks a scene of this process.
    fn ask_here(&self, core: &Core, scene: &mut Scene) -> Result<Self::Answer, Error>;
}
