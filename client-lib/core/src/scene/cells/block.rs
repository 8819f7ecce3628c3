//! Boxes of a cell in blocks of a cache line, and the question which of them may overlap another box.
//!
//! A box takes 16 bytes: a coordinate of each face in quanta of its level, cut to 16 bits, and a word with
//! its index and two flags. Quanta that are less than 2^15 apart compare right by the sign of their 16-bit
//! difference. Those further apart, of boxes far away that share a folded or a border cell, may look near:
//! so a question admits more boxes than overlap, and never fewer.

#![allow(unsafe_code)]

use bytemuck::{Pod, Zeroable};

use super::axis::LONGEST;
use super::quanta::Quanta;

/// Boxes of a block.
pub(super) const SLOTS: u32 = 4;
/// Flag of a word: the box has changed, and its slot holds a hull.
pub(in crate::scene) const CHANGED: u32 = 1 << 31;
/// Flag of a word: the box is static.
pub(in crate::scene) const STATIC: u32 = 1 << 30;
pub(in crate::scene) const INDEX: u32 = STATIC - 1;

/// Mins, negated maxes, and the word: lanes of one comparison.
type Lanes = [i16; 8];

/// A box of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Slot(Lanes);

/// Four boxes. Which of them there are, the cell says.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Block(pub [Slot; SLOTS as usize]);

impl Slot {
    pub const NONE: Self = Self([0; 8]);

    /// A box that is at most [`LONGEST`] quanta long on each axis, and its word.
    #[inline]
    pub fn new(q: &Quanta, word: u32) -> Self {
        let ([x, y, z, _], [far_x, far_y, far_z, _]) =
            (q.min.map(|q| q as i16), q.max.map(|q| (q as i16).wrapping_neg()));
        Self([x, y, z, far_x, far_y, far_z, word as i16, (word >> 16) as i16])
    }

    #[inline]
    pub const fn word(&self) -> u32 {
        self.0[6] as u16 as u32 | (self.0[7] as u16 as u32) << 16
    }

    /// Sets or takes flags of the word.
    #[inline]
    pub const fn set_word(&mut self, word: u32) {
        self.0[6] = word as i16;
        self.0[7] = (word >> 16) as i16;
    }
}

impl Block {
    pub const NONE: Self = Self([Slot::NONE; SLOTS as usize]);
}

/// Bit 7 of each byte: one for each box of a block.
const EACH: u32 = 0x8080_8080;

/// The bits of the first boxes of a block, by how many they are.
pub(super) const FIRST: [u32; SLOTS as usize + 1] = [0, 0x80, 0x8080, 0x0080_8080, EACH];

/// What blocks of a level are asked.
#[derive(Clone, Copy, Debug)]
pub(super) struct Question {
    /// No lane that counts may exceed it.
    outer: Lanes,
    /// A box whose lanes are all below has not changed its pair, unless it has changed itself.
    inner: Lanes,
    /// Lanes that count, one bit each, for four boxes.
    counting: u32,
    /// [`EACH`] where nothing is dismissed.
    undismissed: u32,
}

impl Question {
    /// Which boxes may overlap one of two, or both. Where `dismisses`, not those that are sure to
    /// overlap both, or neither, and have not changed.
    #[inline]
    pub fn new(was: &Quanta, is: &Quanta, dismisses: bool) -> Self {
        let (outer, inner) = (was.hull(is), was.common(is));
        let (mut counting, mut dismisses) = (0, dismisses);
        let lengths = outer.lengths();
        for axis in 0..3 {
            let is_short = lengths[axis] <= LONGEST;
            counting |= if is_short { 0x0909_0909 << axis } else { 0 };
            dismisses &= is_short;
        }
        let lanes = |q: &Quanta| {
            let ([x, y, z, _], [far_x, far_y, far_z, _]) =
                (q.max.map(|q| q as i16), q.min.map(|q| (q as i16).wrapping_neg()));
            [x, y, z, far_x, far_y, far_z, 0, 0]
        };
        let undismissed = if dismisses { 0 } else { EACH };
        Self { outer: lanes(&outer), inner: lanes(&inner), counting, undismissed }
    }

    /// Which nothing is compared with: admits all.
    pub const ALL: Self = Self { outer: [0; 8], inner: [0; 8], counting: 0, undismissed: EACH };

    /// The boxes of a block that are admitted: bit 8 i + 7 for the i-th.
    #[inline(always)]
    pub fn admitted(&self, block: &Block) -> u32 {
        !nonzero_bytes(exceeding(block, &self.outer, 0) & self.counting) & EACH
    }

    /// [`Self::admitted`] with AVX2.
    ///
    /// # Safety
    /// The processor has AVX2.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub unsafe fn admitted_avx2(&self, block: &Block) -> u32 {
        use std::arch::x86_64::{
            __m128i, __m256i, _mm256_broadcastsi128_si256, _mm256_cmpgt_epi16,
            _mm256_movemask_epi8, _mm256_packs_epi16, _mm256_permute4x64_epi64,
            _mm256_setzero_si256, _mm256_sub_epi16,
        };
        let limits: __m128i = bytemuck::cast(self.outer);
        let halves: &[[i16; 16]; 2] = bytemuck::cast_ref(&block.0);
        // SAFETY: as the caller says.
        let exceeding = unsafe {
            let limits = _mm256_broadcastsi128_si256(limits);
            let [low, high] = halves.map(|slots| {
                let slots: __m256i = bytemuck::cast(slots);
                _mm256_cmpgt_epi16(_mm256_sub_epi16(slots, limits), _mm256_setzero_si256())
            });
            // Halves of registers are packed by themselves: boxes 0, 2, 1, 3.
            let packed = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(low, high));
            _mm256_movemask_epi8(packed) as u32
        };
        !nonzero_bytes(exceeding & self.counting) & EACH
    }

    /// The boxes that are dismissed, if they are admitted.
    #[inline(always)]
    pub fn dismissed(&self, block: &Block) -> u32 {
        let unsure = nonzero_bytes(exceeding(block, &self.inner, -1) & self.counting);
        !(unsure | self.undismissed | negative(block)) & EACH
    }
}

/// Bit 7 of each byte that is not zero. Bit 7 itself has to be zero.
#[inline(always)]
const fn nonzero_bytes(bytes: u32) -> u32 {
    (bytes + 0x7f7f_7f7f) & EACH
}

/// Lanes whose difference from the limits is above `most`, one bit each.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn exceeding(block: &Block, limits: &Lanes, most: i16) -> u32 {
    use std::arch::x86_64::{
        __m128i, _mm_cmpgt_epi16, _mm_movemask_epi8, _mm_packs_epi16, _mm_set1_epi16, _mm_sub_epi16,
    };
    let limits: __m128i = bytemuck::cast(*limits);
    let slots = block.0.map(|slot| -> __m128i { bytemuck::cast(slot.0) });
    // SAFETY: every x86-64 processor has SSE2.
    unsafe {
        let most = _mm_set1_epi16(most);
        let [a, b, c, d] = slots.map(|slot| _mm_cmpgt_epi16(_mm_sub_epi16(slot, limits), most));
        let (low, high) = (_mm_packs_epi16(a, b), _mm_packs_epi16(c, d));
        _mm_movemask_epi8(low) as u32 | (_mm_movemask_epi8(high) as u32) << 16
    }
}

/// Lanes whose difference from the limits is above `most`, one bit each.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn exceeding(block: &Block, limits: &Lanes, most: i16) -> u32 {
    let mut bits = 0;
    for (i, slot) in block.0.iter().enumerate() {
        for lane in 0..8 {
            bits |= u32::from(slot.0[lane].wrapping_sub(limits[lane]) > most) << (8 * i + lane);
        }
    }
    bits
}

/// The boxes that have changed.
#[inline(always)]
fn negative(block: &Block) -> u32 {
    let [a, b, c, d] = block.0.map(|slot| u32::from(slot.0[7] < 0));
    a << 7 | b << 15 | c << 23 | d << 31
}

#[cfg(test)]
mod tests {
    use super::super::quanta::Scale;
    use super::*;
    use crate::aabb::Aabb;
    #[cfg(target_arch = "x86_64")]
    use crate::isa::Isa;
    use proptest::prelude::*;

    fn some_box(of: ([i32; 3], [i32; 3]), unit: f32) -> Aabb {
        let (min, edges) = of;
        let max = std::array::from_fn(|axis| (min[axis] + edges[axis]) as f32 * unit);
        Aabb { min: min.map(|x| x as f32 * unit), max }
    }

    fn corners() -> impl Strategy<Value = ([i32; 3], [i32; 3])> {
        // Near each other, or so far that 16 bits do not show.
        let start = prop_oneof![8 => -40..40, 1 => 65_500..65_570, 1 => -65_570..-65_500];
        (prop::array::uniform3(start), prop::array::uniform3(0..30))
    }

    proptest! {
        #[test]
        fn boxes_that_overlap_are_admitted_and_only_those_that_do_not_change_are_dismissed(
            was in corners(),
            is in corners(),
            others in prop::array::uniform4((corners(), any::<bool>(), 0u32..1 << 30)),
            unit in prop_oneof![Just(1.0f32), Just(0.37), Just(271.0)],
        ) {
            let scale = Scale { origin: [0.3; 4], per_unit: [1.0; 4] };
            let [was, is] = [was, is].map(|corners| some_box(corners, unit));
            let [q_was, q_is] = [was, is].map(|b| scale.quanta(&b));
            let boxes = others.map(|(corners, ..)| some_box(corners, unit));
            let words =
                others.map(|(_, changed, index)| index | if changed { CHANGED } else { 0 });
            let slots = std::array::from_fn(|i| Slot::new(&scale.quanta(&boxes[i]), words[i]));
            let block = Block(slots);
            let fits = boxes.map(|b| {
                let lengths = scale.quanta(&b).lengths();
                lengths[..3].iter().all(|length| *length <= LONGEST)
            });
            for dismisses in [false, true] {
                let question = Question::new(&q_was, &q_is, dismisses);
                let bits = question.admitted(&block) & !question.dismissed(&block);
                prop_assert_eq!(bits & !EACH, 0);
                #[cfg(target_arch = "x86_64")]
                if Isa::Avx2.is_available() {
                    // SAFETY: the processor has AVX2, as was just asked.
                    let wide = unsafe { question.admitted_avx2(&block) };
                    prop_assert_eq!(wide, question.admitted(&block));
                }
                for i in 0..4 {
                    prop_assert_eq!(slots[i].word(), words[i]);
                    let found = bits >> (8 * i + 7) & 1 == 1;
                    let [had, has] = [was, is].map(|b| b.overlaps(&boxes[i]));
                    let changed = words[i] & CHANGED != 0;
                    if fits[i] && !found && (had || has) {
                        prop_assert!(dismisses && had && has && !changed);
                    }
                    if fits[i] && !found && dismisses {
                        prop_assert_eq!(had, has);
                    }
                }
            }
            let all = Question::ALL;
            prop_assert_eq!(all.admitted(&block) & !all.dismissed(&block), EACH);
        }
    }
}
