//! Sixteen keys a register in plain Rust, in a form that compilers turn into any SIMD that they have: for
//! all other machines, and as the yardstick of the rest.
#![allow(unsafe_code)]

use super::Simd;
use crate::aabb::{Aabb, order_key};

/// Every machine has it.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

const LANES: usize = 16;

/// Some lanes: those whose bits are all ones, of which the others have none.
type Flags = [u32; LANES];

#[inline(always)]
fn flag(is_one: bool) -> u32 {
    0u32.wrapping_sub(u32::from(is_one))
}

/// One value for each lane: a plain loop, which becomes SIMD.
#[inline(always)]
fn each<T: Copy + Default>(lane: impl Fn(usize) -> T) -> [T; LANES] {
    let mut lanes = [T::default(); LANES];
    for (i, to) in lanes.iter_mut().enumerate() {
        *to = lane(i);
    }
    lanes
}

impl Simd for Portable {
    type Keys = [i32; LANES];
    type Lanes = Flags;
    type Met = Flags;

    const LANES: usize = LANES;

    #[inline(always)]
    fn splat(self, key: i32) -> [i32; LANES] {
        [key; LANES]
    }

    #[inline(always)]
    unsafe fn load_from(self, keys: *const i32) -> [i32; LANES] {
        // SAFETY: the caller vouches for 16 keys.
        unsafe { keys.cast::<[i32; LANES]>().read() }
    }

    #[inline(always)]
    unsafe fn store_to(self, keys: [i32; LANES], to: *mut i32) {
        // SAFETY: the caller vouches for 16 keys.
        unsafe { to.cast::<[i32; LANES]>().write(keys) }
    }

    #[inline(always)]
    fn all_meet(self) -> Flags {
        [u32::MAX; LANES]
    }

    #[inline(always)]
    fn meet(self, met: Flags, [min, max]: [[i32; LANES]; 2], row: [[i32; LANES]; 2]) -> Flags {
        // No early way out: without branches the loop becomes SIMD.
        each(|i| met[i] & flag(min[i] <= row[1][i]) & flag(row[0][i] <= max[i]))
    }

    #[inline(always)]
    fn met_bits(self, met: Flags) -> u32 {
        self.bits(met)
    }

    #[inline(always)]
    fn above(self, a: [i32; LANES], b: [i32; LANES]) -> Flags {
        each(|i| flag(a[i] > b[i]))
    }

    #[inline(always)]
    fn equal(self, a: [i32; LANES], b: [i32; LANES]) -> Flags {
        each(|i| flag(a[i] == b[i]))
    }

    #[inline(always)]
    fn unordered(self, a: [i32; LANES], b: [i32; LANES]) -> Flags {
        // In integers: a NaN is beyond infinity.
        let is_nan = |bits: i32| flag(bits & i32::MAX > f32::INFINITY.to_bits() as i32);
        each(|i| is_nan(a[i]) | is_nan(b[i]))
    }

    #[inline(always)]
    fn either(self, a: Flags, b: Flags) -> Flags {
        each(|i| a[i] | b[i])
    }

    #[inline(always)]
    fn bits(self, lanes: Flags) -> u32 {
        let mut bits = 0;
        for (i, lane) in lanes.iter().enumerate() {
            bits |= lane & 1 << i;
        }
        bits
    }

    #[inline(always)]
    fn select(self, lanes: Flags, chosen: [i32; LANES], others: [i32; LANES]) -> [i32; LANES] {
        each(|i| if lanes[i] != 0 { chosen[i] } else { others[i] })
    }

    #[inline(always)]
    fn order_keys(self, bits: [i32; LANES]) -> [i32; LANES] {
        each(|i| order_key(bits[i] as u32))
    }

    #[inline(always)]
    fn coordinates(self, boxes: &[Aabb]) -> [[i32; LANES]; 6] {
        let words: &[[i32; 6]] = bytemuck::cast_slice(&boxes[..LANES]);
        let mut coordinates = [[0; LANES]; 6];
        for (k, coordinates) in coordinates.iter_mut().enumerate() {
            *coordinates = each(|i| words[i][k]);
        }
        coordinates
    }

    #[inline(always)]
    fn words_of<'a>(self, record: impl Fn(usize) -> &'a [i32; 8]) -> [[i32; LANES]; 8] {
        let mut words = [[0; LANES]; 8];
        for i in 0..LANES {
            for (words, word) in words.iter_mut().zip(record(i)) {
                words[i] = *word;
            }
        }
        words
    }
}
