//! What a scene holds, for who keeps the scene from now on.

use super::store::Store;
use crate::aabb::Aabb;

/// A box that a scene keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeptBox {
    /// The box.
    pub b: Aabb,
    /// Whether it is switched on.
    pub is_on: bool,
    /// Whether it is static.
    pub is_static: bool,
}

/// What a scene has told of its pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeptHistory {
    /// All of them, so many.
    Told(u64),
    /// Not one, and there was none when the history began: the next changes tell all.
    Untold,
    /// The scene has lost track of them: the next changes are a resync.
    Lost,
}

/// The boxes and flags of a scene, where no other box matters to what it tells next.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a> {
    store: &'a Store,
    history: KeptHistory,
}

impl<'a> Kept<'a> {
    pub(super) const fn new(store: &'a Store, history: KeptHistory) -> Self {
        Self { store, history }
    }

    /// Boxes have indices below this.
    pub fn slots(&self) -> usize {
        self.store.boxes().len()
    }

    /// The box of an index.
    pub fn get(&self, index: u32) -> Option<KeptBox> {
        let b = self.store.get(index)?;
        let (is_on, is_static) = (!self.store.is_off(index), self.store.is_static(index));
        Some(KeptBox { b, is_on, is_static })
    }

    /// What was told.
    pub const fn history(&self) -> KeptHistory {
        self.history
    }
}
