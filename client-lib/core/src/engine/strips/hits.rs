//! The strips of a tested batch that have an overlap.

use super::StripBatch;
use super::batch::{BATCH_STRIPS, STRIP_COLUMNS};
#[cfg(target_arch = "x86_64")]
use super::{words_avx2, words_avx512};
use crate::engine::AvailableIsa;
#[cfg(target_arch = "x86_64")]
use crate::engine::Isa;

/// Room for a register behind the last hit.
pub(super) const HITS_ALLOCATED: usize = BATCH_STRIPS + STRIP_COLUMNS;

/// Strips with an overlap, in the order of the batch. Behind the last one stand 16 without bits.
pub(super) struct Hits {
    pub rows: Box<[u32; HITS_ALLOCATED]>,
    /// First column.
    pub starts: Box<[u32; HITS_ALLOCATED]>,
    /// Bit t, of 16: column start + t.
    pub bits: Box<[u32; HITS_ALLOCATED]>,
    len: usize,
}

impl Default for Hits {
    fn default() -> Self {
        let array = || Box::new([0; HITS_ALLOCATED]);
        Self { rows: array(), starts: array(), bits: array(), len: 0 }
    }
}

impl Hits {
    /// Replaces the hits by those of a batch; returns how many pairs they are.
    pub fn collect(&mut self, batch: &StripBatch, isa: AvailableIsa) -> u64 {
        let (len, pairs) = match isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => words_avx512::collect(batch, self, isa),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => words_avx2::collect(batch, self, isa),
            _ => self.collect_portable(batch),
        };
        self.len = len;
        self.bits[self.len..][..STRIP_COLUMNS].fill(0);
        pairs
    }

    /// Whether a strip has a hit is a coin toss: all are copied and those without are overwritten.
    fn collect_portable(&mut self, batch: &StripBatch) -> (usize, u64) {
        let (rows, starts, lanes) = batch.strips();
        let (mut len, mut pairs) = (0, 0);
        for ((&row, &start), &lanes) in rows.iter().zip(starts).zip(lanes) {
            let at = len % BATCH_STRIPS;
            (self.rows[at], self.starts[at], self.bits[at]) = (row, start, u32::from(lanes));
            len += usize::from(lanes != 0);
            pairs += u64::from(lanes.count_ones());
        }
        (len, pairs)
    }

    /// Row, start and bits of a hit.
    #[inline(always)]
    pub fn get(&self, at: usize) -> (u32, u32, u32) {
        (self.rows[at], self.starts[at], self.bits[at])
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn allocated_bytes(&self) -> usize {
        3 * size_of_val(&*self.rows)
    }
}
