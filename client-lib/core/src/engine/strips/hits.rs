//! The strips of a tested batch that have an overlap.

use super::StripBatch;
use super::batch::{BATCH_STRIPS, STRIP_COLUMNS};
use super::words;
use crate::engine::AvailableIsa;

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
        let (len, pairs) = words::collect(batch, self, isa);
        self.len = len;
        self.bits[self.len..][..STRIP_COLUMNS].fill(0);
        pairs
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn allocated_bytes(&self) -> usize {
        3 * size_of_val(&*self.rows)
    }
}
