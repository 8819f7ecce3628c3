//! What a scene holds, for who keeps the scene from now on.

use super::copy::WholeScene;
use super::states::{BoxStates, DISABLED};
use super::store::Store;
use crate::aabb::Aabb;

/// A box that a scene keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxSnapshot {
    /// The box.
    pub b: Aabb,
    /// Whether it is enabled.
    pub is_on: bool,
    /// Whether it is static.
    pub is_static: bool,
}

impl BoxSnapshot {
    pub(super) fn of(b: Aabb, index: u32, states: &BoxStates) -> Self {
        Self {
            b,
            is_on: !states.has(index, DISABLED),
            is_static: states.filter_data(index).is_static(),
        }
    }
}

impl Store {
    /// All of it, as an edit that makes it.
    pub fn whole(&self) -> WholeScene<'_> {
        let snapshot = |index| Some(BoxSnapshot::of(self.get(index)?, index, &self.states));
        WholeScene::of(self.boxes().len(), None, snapshot, &self.states.filters)
    }
}

/// What a scene has reported of its pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HistorySnapshot {
    /// All of them, so many.
    Reported(u64),
    /// Not one, and there was none when the history began: the next changes report all.
    Unreported,
    /// The scene has lost track of them: the next changes are a resync.
    Lost,
}

/// The boxes, flags and collision filters of a scene, where no other box matters to what it reports next.
#[derive(Clone, Copy, Debug)]
pub struct SceneSnapshot<'a> {
    store: &'a Store,
    history: HistorySnapshot,
}

impl<'a> SceneSnapshot<'a> {
    pub(super) const fn new(store: &'a Store, history: HistorySnapshot) -> Self {
        Self { store, history }
    }

    /// All of it, as an edit that makes it.
    pub fn whole(&self) -> WholeScene<'a> {
        self.store.whole()
    }

    /// What was reported.
    pub const fn history(&self) -> HistorySnapshot {
        self.history
    }
}
