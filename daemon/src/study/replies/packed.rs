//! Packed addresses: a row and a block in four bytes.

use super::copy::MaskCopy;
use super::sink::PairSink;

/// Rows that share their high half.
const GROUP_ROWS: usize = 1 << 16;

/// Low half of the row, distance of the block and bits of each word; first word of each group.
#[derive(Clone, Debug)]
pub(super) struct PackedWords {
    /// Number of the first word of each group of 65,536 rows.
    pub starts: Vec<u32>,
    pub low_rows: Vec<u16>,
    /// Column block less the block that the row's own column lies in. Columns come after the row,
    /// so that it is never negative, and the sign's bit doubles the reach: 65,535 blocks, which is
    /// every distance of up to 2,097,152 boxes.
    pub distances: Vec<u16>,
    pub bits: Vec<u32>,
}

impl PackedWords {
    /// The words of a mask, or `None` where a block is too far from its row, or the number of words
    /// is not a u32.
    pub fn of(mask: &MaskCopy) -> Option<Self> {
        u32::try_from(mask.word_count()).ok()?;
        let distance = |(row, block, _)| u16::try_from(u32::checked_sub(block, row / 32)?).ok();
        let distances = mask.words().map(distance).collect::<Option<Vec<u16>>>()?;
        let groups = mask.n().len().div_ceil(GROUP_ROWS);
        let start = |group| mask.rows.partition_point(|row| (*row as usize) < group * GROUP_ROWS);
        Some(Self {
            starts: (0..groups).map(|group| start(group) as u32).collect(),
            low_rows: mask.rows.iter().map(|row| *row as u16).collect(),
            distances,
            bits: mask.bits.clone(),
        })
    }

    pub fn bytes(&self) -> u64 {
        4 * self.starts.len() as u64 + 8 * self.bits.len() as u64
    }

    /// Puts every word.
    #[inline(always)]
    pub fn walk<F: FnMut(u32, u32)>(&self, sink: &mut PairSink<'_, F>) {
        let len = self.bits.len();
        let ends = self.starts.iter().skip(1).map(|end| *end as usize).chain([len]);
        for (group, (start, end)) in (0u32..).zip(self.starts.iter().zip(ends)) {
            let range = *start as usize..end;
            let low_rows = self.low_rows.get(range.clone()).unwrap_or(&[]);
            let distances = self.distances.get(range.clone()).unwrap_or(&[]);
            let bits = self.bits.get(range).unwrap_or(&[]);
            let addresses = low_rows.iter().zip(distances);
            for ((low, distance), bits) in addresses.zip(bits) {
                let row = group << 16 | u32::from(*low);
                let block = row / 32 + u32::from(*distance);
                sink.put_word(row, block.saturating_mul(32), u64::from(*bits));
            }
        }
    }
}
