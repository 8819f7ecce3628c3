//! Rows by prefix: where the words of each row start, in place of each word's row.

use super::copy::MaskCopy;
use super::sink::PairSink;

/// Words whose rows are written out before they are decoded: 1 KiB of the first-level cache.
const BATCH: usize = 256;

/// n + 1 row starts; block and bits of each word.
#[derive(Clone, Debug)]
pub(super) struct PrefixWords {
    /// Number of the first word of each row, and behind the last row the number of words.
    pub starts: Vec<u32>,
    pub blocks: Vec<u32>,
    pub bits: Vec<u32>,
}

impl PrefixWords {
    /// The words of a mask, or `None` where their number is not a u32.
    pub fn of(mask: &MaskCopy) -> Option<Self> {
        u32::try_from(mask.word_count()).ok()?;
        let mut starts = Vec::with_capacity(mask.n().len() + 1);
        let mut start = 0;
        for row in 0..mask.n().get() {
            starts.push(start as u32);
            let rest = mask.rows.get(start..).unwrap_or(&[]);
            start += rest.iter().take_while(|r| **r == row).count();
        }
        starts.push(start as u32);
        Some(Self { starts, blocks: mask.blocks.clone(), bits: mask.bits.clone() })
    }

    pub fn bytes(&self) -> u64 {
        4 * self.starts.len() as u64 + 8 * self.bits.len() as u64
    }

    /// Puts every word.
    ///
    /// How many words a row has is as hard to guess as how many bits a word has: rows are therefore
    /// written out for a batch of words, two at once without a branch, and then read along.
    #[inline(always)]
    pub fn walk<F: FnMut(u32, u32)>(&self, sink: &mut PairSink<'_, F>) {
        let mut rows = [0; BATCH];
        let (mut filled, mut done) = (0, 0);
        let ends = self.starts.iter().skip(1);
        for (row, (start, end)) in (0u32..).zip(self.starts.iter().zip(ends)) {
            let mut count = end.saturating_sub(*start) as usize;
            if filled + 2 > BATCH {
                self.put(&rows[..filled], &mut done, sink);
                filled = 0;
            }
            rows[filled] = row;
            rows[filled + 1] = row;
            filled += count.min(2);
            while count > 2 {
                if filled == BATCH {
                    self.put(&rows, &mut done, sink);
                    filled = 0;
                }
                rows[filled] = row;
                filled += 1;
                count -= 1;
            }
        }
        self.put(&rows[..filled], &mut done, sink);
    }

    /// Puts the words from `done` on, one for each row.
    #[inline(always)]
    fn put<F: FnMut(u32, u32)>(&self, rows: &[u32], done: &mut usize, sink: &mut PairSink<'_, F>) {
        let blocks = self.blocks.get(*done..).unwrap_or(&[]);
        let bits = self.bits.get(*done..).unwrap_or(&[]);
        for ((row, block), bits) in rows.iter().zip(blocks).zip(bits) {
            sink.put_word(*row, block.saturating_mul(32), u64::from(*bits));
        }
        *done += rows.len();
    }
}
