//! What a scene holds, for who keeps the scene from now on.

use super::copy::WholeScene;
use super::states::{BoxStates, OFF};
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

impl KeptBox {
    pub(super) fn of(b: Aabb, index: u32, states: &BoxStates) -> Self {
        Self { b, is_on: !states.has(index, OFF), is_static: states.tag(index).is_static() }
    }
}

/// What a scene has told of its pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeptHistory {
    /// All of them, so many.
    Reported(u64),
    /// Not one, and there was none when the history began: the next changes tell all.
    Unreported,
    /// The scene has lost track of them: the next changes are a resync.
    Lost,
}

/// The boxes, flags and collision filters of a scene, where no other box matters to what it tells next.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a> {
    store: &'a Store,
    history: KeptHistory,
}

impl<'a> Kept<'a> {
    pub(super) const fn new(store: &'a Store, history: KeptHistory) -> Self {
        Self { store, history }
    }

    /// All of it, as an edit that makes it.
    pub fn whole(&self) -> WholeScene<'a> {
        let store = self.store;
        let kept = |index| Some(KeptBox::of(store.get(index)?, index, &store.states));
        WholeScene::of(store.boxes().len(), None, kept, &store.states.filters)
    }

    /// What was reported.
    pub const fn history(&self) -> KeptHistory {
        self.history
    }
}
