//! Words of 64 bits: two neighbouring words of a row share an address.

use super::copy::MaskCopy;
use super::sink::PairSink;

/// Row, block of 64 columns and bits of each word.
#[derive(Clone, Debug)]
pub(super) struct LongWords {
    pub rows: Vec<u32>,
    pub blocks: Vec<u32>,
    /// Lower columns first.
    pub bits: Vec<[u32; 2]>,
}

impl LongWords {
    /// The words of a mask.
    pub fn of(mask: &MaskCopy) -> Self {
        let mut long = Self { rows: Vec::new(), blocks: Vec::new(), bits: Vec::new() };
        for (row, block, bits) in mask.words() {
            let (long_block, half) = (block / 2, (block % 2) as usize);
            if (long.rows.last(), long.blocks.last()) != (Some(&row), Some(&long_block)) {
                long.rows.push(row);
                long.blocks.push(long_block);
                long.bits.push([0; 2]);
            }
            if let Some(last) = long.bits.last_mut() {
                last[half] |= bits;
            }
        }
        long
    }

    pub fn bytes(&self) -> u64 {
        16 * self.bits.len() as u64
    }

    /// Puts every word.
    #[inline(always)]
    pub fn walk<F: FnMut(u32, u32)>(&self, sink: &mut PairSink<'_, F>) {
        let addresses = self.rows.iter().zip(&self.blocks);
        for ((row, block), [low, high]) in addresses.zip(&self.bits) {
            let bits = u64::from(*low) | u64::from(*high) << 32;
            sink.put_word(*row, block.saturating_mul(64), bits);
        }
    }
}
