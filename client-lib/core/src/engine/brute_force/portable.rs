//! Comparison in plain Rust, in a form that compilers turn into whatever SIMD they have.

use super::kernel::{Columns, Kernel};
use crate::aabb::KeyBox;
use crate::engine::ingest::WORD_COLUMNS;

/// Plain Rust.
pub(super) struct Portable;

impl Kernel for Portable {
    type Row = KeyBox;

    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn row(key: &KeyBox) -> KeyBox {
        *key
    }

    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn word(row: &KeyBox, columns: &Columns<'_>) -> u64 {
        let mut hits = [0u8; WORD_COLUMNS];
        for (t, hit) in hits.iter_mut().enumerate() {
            // No early way out: without branches the loop becomes SIMD.
            *hit = u8::from(row.min[0] <= columns[3][t])
                & u8::from(columns[0][t] <= row.max[0])
                & u8::from(row.min[1] <= columns[4][t])
                & u8::from(columns[1][t] <= row.max[1])
                & u8::from(row.min[2] <= columns[5][t])
                & u8::from(columns[2][t] <= row.max[2]);
        }
        hits.as_chunks().0.iter().rev().fold(0, |bits, group| bits << 8 | u64::from(pack(*group)))
    }
}

/// Eight bytes of 0 or 1 → eight bits, the first byte lowest.
#[inline(always)]
fn pack(bytes: [u8; 8]) -> u8 {
    // The multiplication adds byte i, shifted to bit 56 + i; no two partial products meet.
    (u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

#[cfg(test)]
mod tests {
    use super::pack;

    #[test]
    fn every_byte_packs() {
        for value in 0..=255u8 {
            assert_eq!(pack(std::array::from_fn(|i| value >> i & 1)), value);
        }
    }
}
