//! Boxes that overlap nothing, counted and named.

use crate::aabb::{Aabb, BoxClass};
use crate::floats;

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
    /// The census of these boxes.
    pub fn of(boxes: &[Aabb]) -> Self {
        let mut census = Self::default();
        floats::with_default(|| {
            for (index, b) in (0..).zip(boxes) {
                census.note_box(index, b);
            }
        });
        census
    }

    /// Counts box `index`, and says whether it is valid. Call with rising indices and the default floating-point
    /// flags.
    #[inline(always)]
    pub(crate) fn note_box(&mut self, index: u32, b: &Aabb) -> bool {
        // False with a NaN. Nearly all boxes are valid, so that only the others are classified.
        let [x, y, z] = std::array::from_fn(|axis| b.min[axis] <= b.max[axis]);
        let is_valid = x & y & z;
        if !is_valid {
            self.note(index, b.class());
        }
        is_valid
    }

    /// Counts box `index`. Call with rising indices.
    #[inline]
    pub fn note(&mut self, index: u32, class: BoxClass) {
        match class {
            BoxClass::Valid => {}
            BoxClass::Empty => self.empty += 1,
            BoxClass::Invalid => {
                if let Some(slot) = self.first_invalid.get_mut(self.invalid as usize) {
                    *slot = index;
                }
                self.invalid += 1;
            }
        }
    }

    /// The same of boxes that stand behind `first` others.
    #[must_use]
    pub(crate) fn behind(mut self, first: u32) -> Self {
        for index in &mut self.first_invalid[..(self.invalid as usize).min(NAMED_INVALID)] {
            *index += first;
        }
        self
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

    /// How many of `n` boxes, those of the census, are valid.
    pub(crate) const fn valid_of(&self, n: usize) -> usize {
        n - (self.empty + self.invalid) as usize
    }

    /// The indices that were kept.
    pub fn named_invalid(&self) -> &[u32] {
        &self.first_invalid[..(self.invalid as usize).min(NAMED_INVALID)]
    }
}

#[cfg(test)]
mod tests {
    use super::Census;
    use crate::aabb::Aabb;

    #[test]
    fn counts_what_the_class_of_each_box_says() {
        let corners =
            [f32::NAN, f32::NEG_INFINITY, -1.0, -1e-45, -0.0, 0.0, 1e-45, 1.0, f32::INFINITY];
        let boxes: Vec<Aabb> = (0..corners.len().pow(4))
            .map(|at| {
                let [a, b, c, d] =
                    [0, 1, 2, 3].map(|position| corners[at / 9usize.pow(position) % 9]);
                Aabb::new([a, c, 0.0], [b, d, 0.0])
            })
            .collect();
        let mut census = Census::default();
        (0..).zip(&boxes).for_each(|(index, b)| census.note(index, b.class()));
        assert!(census.invalid > 0 && census.empty > 0);
        assert_eq!(Census::of(&boxes), census);
    }
}
