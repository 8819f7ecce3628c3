//! A box in its cell, and the question whether it overlaps another: eight integers each, compared
//! lane by lane.

use crate::aabb::KeyBox;

/// A box of a cell: keys of its min, complements of the keys of its max, whether it is static, and
/// its index. Complements order the other way round, so that overlap is one comparison of all lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(32))]
pub(in crate::scene) struct Entry([i32; 8]);

/// What an entry is compared with: no lane of it may exceed that of the question.
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) struct Question([i32; 8]);

impl Entry {
    /// No box: fails every question, since no key reaches `i32::MAX`.
    pub const FREE: Self = Self([i32::MAX; 8]);

    /// The entry of a box that is not [`KeyBox::NOTHING`].
    #[inline]
    pub fn new(key: &KeyBox, is_static: bool, index: u32) -> Self {
        let [x, y, z] = key.min;
        let [far_x, far_y, far_z] = key.max.map(|key| !key);
        Self([x, y, z, far_x, far_y, far_z, i32::from(is_static), index as i32])
    }

    #[inline]
    pub const fn is_free(&self) -> bool {
        self.0[0] == i32::MAX
    }

    #[inline]
    pub const fn index(&self) -> u32 {
        self.0[7] as u32
    }

    pub const fn is_static(&self) -> bool {
        self.0[6] == 1
    }

    /// The keys of the box.
    #[inline]
    pub fn key(&self) -> KeyBox {
        let [x, y, z, far_x, far_y, far_z, ..] = self.0;
        KeyBox { min: [x, y, z], max: [far_x, far_y, far_z].map(|key| !key) }
    }
}

impl Question {
    /// Admits nothing.
    pub const NONE: Self = Self([i32::MIN; 8]);

    /// Which boxes overlap one and may be a pair with it: two static boxes may not.
    #[inline]
    pub fn new(key: &KeyBox, is_static: bool) -> Self {
        let [x, y, z] = key.max;
        let [near_x, near_y, near_z] = key.min.map(|key| !key);
        Self([x, y, z, near_x, near_y, near_z, i32::from(!is_static), i32::MAX])
    }

    /// The question of an entry; that of a free one admits nothing.
    #[inline]
    pub fn of(entry: &Entry) -> Self {
        if entry.is_free() { Self::NONE } else { Self::new(&entry.key(), entry.is_static()) }
    }

    /// Whether an entry is such a box. The box itself overlaps itself.
    #[inline(always)]
    pub fn admits(&self, entry: &Entry) -> bool {
        // Lanes of all ones or zeroes without a branch: two SIMD comparisons. Indices above 2^31 − 1 are
        // negative lanes.
        let lanes: [i32; 8] = std::array::from_fn(|lane| -i32::from(entry.0[lane] > self.0[lane]));
        let halves: [i32; 4] = std::array::from_fn(|lane| lanes[lane] | lanes[lane + 4]);
        (halves[0] | halves[1]) | (halves[2] | halves[3]) == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_entry_is_admitted_where_boxes_overlap_unless_both_are_static(
            a in prop::array::uniform6(-3i32..4),
            b in prop::array::uniform6(-3i32..4),
            statics in prop::array::uniform2(any::<bool>()),
            index in any::<u32>(),
        ) {
            let [a, b] = [a, b].map(|v| KeyBox::from(&Aabb::from(v.map(|x| x as f32))));
            prop_assume!(a != KeyBox::NOTHING && b != KeyBox::NOTHING);
            let entry = Entry::new(&b, statics[1], index);
            let question = Question::new(&a, statics[0]);
            prop_assert_eq!(question.admits(&entry), a.overlaps(&b) && statics != [true; 2]);
            prop_assert_eq!((entry.key(), entry.index()), (b, index));
            prop_assert_eq!((entry.is_static(), entry.is_free()), (statics[1], false));
            prop_assert!(!question.admits(&Entry::FREE) && Entry::FREE.is_free());
        }
    }

    #[test]
    fn a_plane_without_end_admits_no_free_entry() {
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        assert!(!Question::new(&KeyBox::from(&all), false).admits(&Entry::FREE));
    }
}
