//! What Rust and the stages of the sweep share. A test compares it with naga's reflection.

use bytemuck::{Pod, Zeroable};

/// Parameters of every stage of the sweep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SweepParams {
    /// Boxes.
    pub n: u32,
    /// Entries that there is room for.
    pub entry_capacity: u32,
    /// Pairs that there is room for.
    pub pair_capacity: u32,
    /// Axis of the sort, and the two that tubes divide: a byte each, from the lowest on.
    pub axes: u32,
    /// Bits of a place along the axis of the sort.
    pub place_bits: u32,
    /// Bits of a tube's number along the second axis.
    pub tube_bits_0: u32,
    /// Bits of a tube's number along the third axis.
    pub tube_bits_1: u32,
    /// Number of the sort's pass.
    pub pass_number: u32,
    /// First bit of its digit.
    pub shift: u32,
    /// Tiles of the sort that there is room for.
    pub tiles: u32,
    /// Rounds of loops that a thread may take.
    pub thread_rounds: u32,
    /// Where places begin.
    pub origin_0: f32,
    /// Where tubes begin along the second axis.
    pub origin_1: f32,
    /// Where tubes begin along the third axis.
    pub origin_2: f32,
    /// Places a unit.
    pub scale_0: f32,
    /// Tubes a unit along the second axis.
    pub scale_1: f32,
    /// Tubes a unit along the third axis.
    pub scale_2: f32,
}

/// Words of the control block: entries, found pairs, tests (two words), whether a thread would have taken too many
/// rounds; entries by digit from `DIGITS_AT` of the stages on, for each pass.
pub const CONTROL_WORDS: usize = 16 + 16 * PASSES_MOST as usize;

/// Bits of a digit of the sort.
pub const DIGIT_BITS: u32 = 4;
/// Digits of the sort.
pub const DIGITS: u32 = 1 << DIGIT_BITS;
/// Passes of a key of 32 bits.
pub const PASSES_MOST: u32 = 32 / DIGIT_BITS;
/// Entries of a tile of the sort: eight a thread.
pub const TILE: u32 = 8 * pairmask_shaders::constants::BATCH_BOXES;
