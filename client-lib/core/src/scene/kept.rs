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

/// The boxes and flags of a scene that has not changed since the last taken answer.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a> {
    store: &'a Store,
    pair_count: Option<u64>,
}

impl<'a> Kept<'a> {
    pub(super) const fn new(store: &'a Store, pair_count: Option<u64>) -> Self {
        Self { store, pair_count }
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

    /// Pairs that were told; `None` where the scene has lost track of them, so that the next changes
    /// are a resync.
    pub const fn pair_count(&self) -> Option<u64> {
        self.pair_count
    }
}
