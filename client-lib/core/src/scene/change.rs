//! Whether a pair began or ended: the boxes as they were when the history began, against those of now.

use super::store::{Solid, Store};

/// A box: what it was when the history began, and what it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct WasIs {
    pub was: Solid,
    pub is: Solid,
    /// It was removed meanwhile: what is there is another one.
    pub was_removed: bool,
}

impl WasIs {
    /// The box of an index.
    #[inline]
    pub fn of(index: u32, store: &Store) -> Self {
        let is = store.now(index);
        match store.before(index) {
            Some(was) => Self { was, is, was_removed: store.was_removed(index) },
            None => Self::unchanged(is),
        }
    }

    /// A box that has not changed.
    #[inline]
    pub const fn unchanged(is: Solid) -> Self {
        Self { was: is, is, was_removed: false }
    }

    /// Whether no more than the place of the box has changed.
    #[inline]
    pub const fn is_same(&self) -> bool {
        self.was.is_static == self.is.is_static && !self.was_removed
    }

    /// Whether its pair with another box began, and whether it ended.
    #[inline]
    pub fn change(&self, other: &Self) -> [bool; 2] {
        let (had, has) = (are_pair(&self.was, &other.was), are_pair(&self.is, &other.is));
        let is_replaced = had && has && (self.was_removed || other.was_removed);
        [has && (!had || is_replaced), had && (!has || is_replaced)]
    }
}

/// Whether two boxes are a pair.
#[inline]
pub(super) fn are_pair(a: &Solid, b: &Solid) -> bool {
    !(a.is_static && b.is_static) && a.b.overlaps(&b.b)
}
