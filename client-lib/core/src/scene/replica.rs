//! A scene's boxes by index, whichever keeps them: a scene, or the copy of its client.

use super::Scene;
use super::copy::{SceneCopy, WholeScene};
use super::snapshot::BoxSnapshot;
use super::states::BoxStates;
use super::store::Store;
use crate::aabb::Aabb;

/// The boxes of a scene by index, to be read.
#[derive(Clone, Copy, Debug)]
pub struct Replica<'a>(Holder<'a>);

#[derive(Clone, Copy, Debug)]
enum Holder<'a> {
    Copy(&'a SceneCopy),
    Store(&'a Store),
}

impl<'a> From<&'a SceneCopy> for Replica<'a> {
    fn from(copy: &'a SceneCopy) -> Self {
        Self(Holder::Copy(copy))
    }
}

impl<'a> From<&'a Scene> for Replica<'a> {
    fn from(scene: &'a Scene) -> Self {
        Self(Holder::Store(&scene.store))
    }
}

impl<'a> Replica<'a> {
    /// The box of an index, also one that is disabled.
    #[inline]
    pub fn get(&self, index: u32) -> Option<Aabb> {
        match self.0 {
            Holder::Copy(copy) => copy.get(index),
            Holder::Store(store) => store.get(index),
        }
    }

    /// The box of an index, its flags and filter data.
    pub(super) fn snapshot(&self, index: u32) -> Option<BoxSnapshot> {
        match self.0 {
            Holder::Copy(copy) => copy.snapshot(index),
            Holder::Store(store) => store.snapshot(index),
        }
    }

    /// Prefetches what is kept of an index.
    #[inline]
    pub(super) fn ask_for(&self, index: u32) {
        match self.0 {
            Holder::Copy(copy) => {
                copy.ask_for(index);
                copy.states().ask_for(index);
            }
            Holder::Store(store) => {
                store.ask_for_box(index);
                store.states.ask_for(index);
            }
        }
    }

    /// All of it, as an edit that makes it where there is no box.
    pub fn whole(&self) -> WholeScene<'a> {
        match self.0 {
            Holder::Copy(copy) => copy.whole(),
            Holder::Store(store) => store.whole(),
        }
    }

    /// What is known of each index beside its box.
    pub(super) const fn states(&self) -> &'a BoxStates {
        match self.0 {
            Holder::Copy(copy) => copy.states(),
            Holder::Store(store) => &store.states,
        }
    }

    /// The user data of an index, also after its box was removed, until another has the index.
    pub fn user_data(&self, index: u32) -> u64 {
        self.states().user_data(index)
    }

    /// Indices with a box are below this.
    pub fn index_end(&self) -> u32 {
        self.states().index_end() as u32
    }
}
