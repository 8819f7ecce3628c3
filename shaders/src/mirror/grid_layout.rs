//! `shared/grid_layout`: from a coordinate to a cell number.
//!
//! The same f32 steps as on the device; why no pair is lost to their rounding stands where the host
//! chooses the axes.

use pairmask_core::aabb::{KeyBox, order_key};

use crate::layouts::GridLevel;

/// 1.5 · 2^23: adding it rounds a number of magnitude below 2^22 to an integer.
const ROUND: f32 = 12_582_912.0;
/// Bits of 2^−60: from there to 2^60 no step meets a subnormal or an infinity.
pub const TINY_BITS: u32 = 0x2180_0000;
/// Bits of 2^60.
const HUGE_BITS: u32 = 0x5d80_0000;
const SIGN_BIT: u32 = 0x8000_0000;

/// The number without what WGSL does not promise.
pub fn plain(x: f32) -> f32 {
    let bits = x.to_bits();
    let magnitude = bits & !SIGN_BIT;
    let held = if magnitude < TINY_BITS { 0 } else { magnitude.min(HUGE_BITS) };
    f32::from_bits(held | (bits & SIGN_BIT))
}

/// Unfolded cell number of a coordinate.
pub fn cell(level: &GridLevel, axis: usize, x: f32) -> i32 {
    let cells = (plain(x) - level.origin[axis]) * level.scale[axis];
    let held = cells.max(level.low[axis]).min(level.high[axis]);
    (held + ROUND).to_bits() as i32 - ROUND.to_bits() as i32
}

/// The coordinates of a key box, min and max: the map to keys is its own inverse, but for −0.
pub fn coordinates(keys: &KeyBox) -> [[f32; 3]; 2] {
    let of = |key: i32| f32::from_bits(order_key(key as u32) as u32);
    [keys.min.map(of), keys.max.map(of)]
}

/// Cell number in the table of a level.
pub(super) fn folded(level: &GridLevel, axis: usize, cell: i32) -> u32 {
    (cell & level.fold[axis]) as u32
}
