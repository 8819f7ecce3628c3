//! A box and the question whether it overlaps another: eight integers each, compared lane by lane.

use super::lanes::{Lanes, none_exceeds};
use crate::aabb::{Aabb, INFINITY_BITS, KeyBox, order_key};

/// A box: keys of its min and whether it is static, complements of the keys of its max and its
/// index. Complements order the other way round, so that overlap is one comparison of all lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(32))]
pub(super) struct Entry([Lanes; 2]);

/// What an entry is compared with: no lane of it may exceed that of the question.
#[derive(Clone, Copy, Debug)]
pub(super) struct Question([Lanes; 2]);

impl Entry {
    /// No box: fails every question, since no key reaches `i32::MAX`.
    pub const FREE: Self = Self([[i32::MAX; 4]; 2]);

    /// The entry of a box that is not [`KeyBox::NOTHING`].
    /// The entry of a box; [`Self::FREE`] for one that overlaps nothing.
    #[inline]
    pub fn of(b: &Aabb, is_static: bool, index: u32) -> Self {
        let lanes = |[x, y, z]: [f32; 3]| [x, y, z, 0.0].map(|x| x.to_bits() as i32);
        let (min, max) = (lanes(b.min), lanes(b.max));
        let (low, high) = (keys(min), keys(max));
        // Without branches but one, as `KeyBox::classify` has it.
        let is_nothing: Lanes = std::array::from_fn(|lane| {
            let nan = magnitude(min[lane]).max(magnitude(max[lane])) > INFINITY_BITS as i32;
            i32::from(nan) | i32::from(low[lane] > high[lane])
        });
        if (is_nothing[0] | is_nothing[1]) | is_nothing[2] != 0 {
            return Self::FREE;
        }
        let [x, y, z, _] = low;
        let [far_x, far_y, far_z, _] = high.map(|key| !key);
        Self([[x, y, z, i32::from(is_static)], [far_x, far_y, far_z, index as i32]])
    }

    /// Whether the boxes of two entries that are not free overlap.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.key().overlaps(&other.key())
    }

    /// The hull of two boxes. Neither entry is free.
    #[inline]
    pub fn hull(&self, other: &Self) -> Aabb {
        let least = |half: usize| -> Lanes {
            std::array::from_fn(|lane| self.0[half][lane].min(other.0[half][lane]))
        };
        let [min, max] = [keys(least(0)), keys(least(1).map(|key| !key))];
        let corner = |[x, y, z, _]: Lanes| [x, y, z].map(|bits| f32::from_bits(bits as u32));
        Aabb { min: corner(min), max: corner(max) }
    }

    /// What two boxes have in common; free, or a box with `min` above `max`, where that is nothing.
    #[inline]
    pub fn common(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|half| {
            std::array::from_fn(|lane| self.0[half][lane].max(other.0[half][lane]))
        }))
    }

    /// Whether the box is static, or there is none.
    #[inline]
    pub const fn is_static(&self) -> bool {
        self.0[0][3] > 0
    }

    /// The same box, not static.
    #[inline]
    pub const fn of_no_flag(mut self) -> Self {
        self.0[0][3] = 0;
        self
    }

    #[inline]
    pub const fn is_free(&self) -> bool {
        self.0[0][0] == i32::MAX
    }

    #[inline]
    pub const fn index(&self) -> u32 {
        self.0[1][3] as u32
    }

    #[inline]
    pub fn key(&self) -> KeyBox {
        let [[x, y, z, _], [far_x, far_y, far_z, _]] = self.0;
        KeyBox { min: [x, y, z], max: [far_x, far_y, far_z].map(|key| !key) }
    }
}

/// The bits of a coordinate without its sign.
#[inline(always)]
const fn magnitude(bits: i32) -> i32 {
    bits & 0x7fff_ffff
}

/// Keys of four coordinates; and coordinates of keys, but for −0.
#[inline(always)]
fn keys(bits: Lanes) -> Lanes {
    bits.map(|bits| order_key(bits as u32))
}

impl Question {
    /// Admits nothing.
    pub const NONE: Self = Self([[i32::MIN; 4]; 2]);

    /// Which boxes overlap that of an entry and may be a pair with it: two static boxes may not. That
    /// of a free one admits nothing.
    #[inline]
    pub fn of(entry: &Entry) -> Self {
        if entry.is_free() {
            return Self::NONE;
        }
        let [[x, y, z, is_static], [far_x, far_y, far_z, _]] = entry.0;
        Self([[!far_x, !far_y, !far_z, 1 - is_static], [!x, !y, !z, i32::MAX]])
    }

    /// Whether an entry is such a box. The box itself overlaps itself.
    #[inline(always)]
    pub fn admits(&self, entry: &Entry) -> bool {
        // Indices above 2^31 − 1 are negative lanes.
        none_exceeds(entry.0, self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_entry_is_admitted_where_boxes_overlap_unless_both_are_static(
            a in (prop::array::uniform3(-3i32..4), prop::array::uniform3(0i32..3)),
            b in (prop::array::uniform3(-3i32..4), prop::array::uniform3(0i32..3)),
            statics in prop::array::uniform2(any::<bool>()),
            index in any::<u32>(),
        ) {
            let [a, b] = [a, b].map(|(min, edges)| {
                let max = std::array::from_fn(|axis| (min[axis] + edges[axis]) as f32);
                Aabb { min: min.map(|x| x as f32), max }
            });
            let entry = Entry::of(&b, statics[1], index);
            let question = Question::of(&Entry::of(&a, statics[0], 0));
            prop_assert_eq!(question.admits(&entry), a.overlaps(&b) && statics != [true; 2]);
            prop_assert!(!entry.is_free());
            prop_assert!(!question.admits(&Entry::FREE) && Entry::FREE.is_free());
        }

        #[test]
        fn entries_of_boxes_of_any_bits_have_their_keys(a in prop::array::uniform6(any::<u32>()), near in any::<bool>()) {
            let special = [0, 0x8000_0000, 1, 0x7f80_0000, 0xff80_0000, 0x7f80_0001, 0xffff_ffff, 0x3f80_0000];
            let bits = a.map(|bits| if near { special[bits as usize % 8] } else { bits });
            let b = Aabb::from(bits.map(f32::from_bits));
            let key = KeyBox::from(&b);
            let entry = Entry::of(&b, true, 7);
            prop_assert_eq!(entry.is_free(), key == KeyBox::NOTHING);
            if key != KeyBox::NOTHING {
                prop_assert_eq!((entry.key(), entry.is_static(), entry.index()), (key, true, 7));
                let other = Aabb::from([-1.0, 0.0, 1.0, 5.0, 6.0, 7.0]);
                let hull = KeyBox::from(&other);
                let joined = KeyBox::from(&entry.hull(&Entry::of(&other, false, 3)));
                prop_assert_eq!(joined.min, std::array::from_fn(|x| key.min[x].min(hull.min[x])));
                prop_assert_eq!(joined.max, std::array::from_fn(|x| key.max[x].max(hull.max[x])));
            }
        }
    }

    #[test]
    fn a_plane_without_end_admits_no_free_entry() {
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        assert!(!Question::of(&Entry::of(&all, false, 0)).admits(&Entry::FREE));
    }
}
