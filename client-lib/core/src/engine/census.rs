//! Boxes that overlap nothing, counted and named.

use crate::aabb::BoxClass;

/// How many indices of invalid boxes a reply names.
pub const NAMED_INVALID: usize = 8;

/// Boxes that overlap nothing, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Boxes with a NaN.
    pub invalid: u32,
    /// Boxes with `min > max` on some axis.
    pub empty: u32,
    /// The lowest indices of invalid boxes, the first `min(invalid, 8)` of them.
    pub first_invalid: [u32; NAMED_INVALID],
}

impl Census {
    /// Counts box `index`. Call with rising indices.
    #[inline]
    pub fn note(&mut self, index: u32, class: BoxClass) {
        match class {
            BoxClass::Solid => {}
            BoxClass::Empty => self.empty += 1,
            BoxClass::Invalid => {
                if let Some(slot) = self.first_invalid.get_mut(self.invalid as usize) {
                    *slot = index;
                }
                self.invalid += 1;
            }
        }
    }

    /// Joins the census of a later range of boxes to this one.
    #[must_use]
    pub fn then(mut self, later: &Self) -> Self {
        for slot in later.named_invalid() {
            if let Some(free) = self.first_invalid.get_mut(self.invalid as usize) {
                *free = *slot;
            }
            self.invalid += 1;
        }
        self.invalid += later.invalid - later.named_invalid().len() as u32;
        self.empty += later.empty;
        self
    }

    /// The indices that were kept.
    pub fn named_invalid(&self) -> &[u32] {
        &self.first_invalid[..(self.invalid as usize).min(NAMED_INVALID)]
    }
}
