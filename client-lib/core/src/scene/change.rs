//! Whether a pair began or ended: the boxes as they were when the history began, against those of now.

use super::states::LOST;
use super::store::{BoxState, Store};

/// A box: what it was when the history began, and what it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct WasIs {
    pub was: BoxState,
    pub is: BoxState,
    /// Pairs of it may have changed although it has not moved: it is another box, or its filter data have changed.
    pub is_touched: bool,
}

impl WasIs {
    #[inline]
    pub fn of(index: u32, store: &Store) -> Self {
        let is = store.now(index);
        let is_touched = || store.states.has(index, LOST) || store.is_refiltered(index);
        match store.before(index) {
            Some(was) => Self { was, is, is_touched: is_touched() },
            None => Self::unchanged(is),
        }
    }

    #[inline]
    pub const fn unchanged(is: BoxState) -> Self {
        Self { was: is, is, is_touched: false }
    }

    /// Whether no more than the place of the box has changed.
    #[inline]
    pub const fn is_same(&self) -> bool {
        self.was.is_static == self.is.is_static && !self.is_touched
    }

    /// Whether it overlapped another box, and overlaps it, unless both were or are still.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> [bool; 2] {
        [overlap(&self.was, &other.was), overlap(&self.is, &other.is)]
    }
}

/// Whether two boxes overlap that are not both still.
#[inline]
pub(super) fn overlap(a: &BoxState, b: &BoxState) -> bool {
    !(a.is_static && b.is_static) && a.b.overlaps(&b.b)
}

/// Whether a pair began, and whether it ended, of boxes that overlapped and overlap. The one place where filters
/// and incarnations come to places.
#[inline]
pub(super) fn change(pair: [u32; 2], [overlapped, overlap]: [bool; 2], store: &Store) -> [bool; 2] {
    let filters = &store.states.filters;
    let had = overlapped && filters.met(pair);
    let has = overlap && filters.meet(pair);
    let is_replaced = had && has && store.states.has_either(pair, LOST);
    begins_and_ends(had, has, is_replaced)
}

/// Whether a pair that was one or not, and is one or not, began, and whether it ended: both where it is another one.
#[inline]
pub(super) const fn begins_and_ends(was: bool, is: bool, is_another: bool) -> [bool; 2] {
    [is && (!was || is_another), was && (!is || is_another)]
}
