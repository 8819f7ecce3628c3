//! What a scene holds, for who keeps the scene from now on.

use super::copy::WholeScene;
use super::states::{BoxStates, DISABLED};
use super::store::Store;
use crate::aabb::Aabb;
use crate::filters::FilterData;

/// A box that a scene keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxSnapshot {
    /// The box.
    pub b: Aabb,
    /// Whether it is enabled.
    pub is_on: bool,
    /// Its filter data, with its static flag.
    pub filter_data: FilterData,
    /// Its user data.
    pub user_data: u64,
}

impl BoxSnapshot {
    pub(super) fn of(b: Aabb, index: u32, states: &BoxStates) -> Self {
        Self {
            b,
            is_on: !states.has(index, DISABLED),
            filter_data: states.filter_data(index),
            user_data: states.user_data(index),
        }
    }

    /// Whether it is static by its own flag.
    pub const fn is_static(&self) -> bool {
        self.filter_data.is_static()
    }
}

impl Store {
    /// All of it, as an edit that makes it.
    pub fn whole(&self) -> WholeScene<'_> {
        WholeScene::of(self.boxes().len(), None, |index| self.snapshot(index), &self.states.filters)
    }

    /// The box of an index, its flags and filter data.
    pub(super) fn snapshot(&self, index: u32) -> Option<BoxSnapshot> {
        Some(BoxSnapshot::of(self.get(index)?, index, &self.states))
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
