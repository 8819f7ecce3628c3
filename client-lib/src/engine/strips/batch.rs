//! A batch of strips and the kernels that test it.

use super::ordered::{KeyArrays, OrderedBoxes};
use super::portable;
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};
use crate::engine::{AvailableIsa, Isa};

/// Columns of a strip: the lanes of an AVX-512 register.
pub(crate) const STRIP_COLUMNS: usize = 16;

/// Strips tested at a time: 10 KiB of addresses and answers, which with the keys of a few hundred
/// rows stay in the first-level cache.
const BATCH_STRIPS: usize = 1024;

/// Strips that [`StripBatch::push_group`] copies at a time, wanted or not.
pub(crate) const GROUP: usize = 8;

/// Room for the copies of the last group that were not wanted.
const ALLOCATED: usize = BATCH_STRIPS + GROUP;

/// Strips of a row that are the same for all rows of a cell.
pub(crate) struct StripGroup<'a> {
    pub starts: &'a [u32; GROUP],
    pub lanes: &'a [u16; GROUP],
    /// How many of them are wanted: the first ones.
    pub count: usize,
}

/// Strips to be tested: addresses in, hit bits out. Rows and starts must rise.
pub(crate) struct StripBatch {
    rows: Box<[u32; ALLOCATED]>,
    starts: Box<[u32; ALLOCATED]>,
    /// Before the test the columns that belong to the run, after it those of them that overlap.
    lanes: Box<[u16; ALLOCATED]>,
    len: usize,
    compared: u64,
}

impl Default for StripBatch {
    fn default() -> Self {
        Self {
            rows: Box::new([0; ALLOCATED]),
            starts: Box::new([0; ALLOCATED]),
            lanes: Box::new([0; ALLOCATED]),
            len: 0,
            compared: 0,
        }
    }
}

/// A strip with at least one overlap.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    pub row: u32,
    pub start: u32,
    pub bits: u16,
}

impl StripBatch {
    /// Strips that can still be pushed.
    #[inline(always)]
    pub fn room(&self) -> usize {
        BATCH_STRIPS - self.len
    }

    /// Columns compared since the last call.
    pub fn take_compared(&mut self) -> u64 {
        std::mem::take(&mut self.compared)
    }

    /// Adds the strip of the first columns of `start..end`, and returns where the next one starts.
    /// An empty run costs no strip and no branch. There must be [`Self::room`].
    #[inline(always)]
    pub fn push(&mut self, row: u32, start: u32, end: u32) -> u32 {
        let count = end.saturating_sub(start).min(STRIP_COLUMNS as u32);
        let at = self.len.min(BATCH_STRIPS);
        self.rows[at] = row;
        self.starts[at] = start;
        self.lanes[at] = ((1u32 << count) - 1) as u16;
        self.len += usize::from(count != 0);
        start + count
    }

    /// Adds up to [`GROUP`] strips at the price of two. There must be [`Self::room`] for them.
    #[inline(always)]
    pub fn push_group(&mut self, row: u32, group: &StripGroup<'_>) {
        let at = self.len.min(BATCH_STRIPS);
        // Fixed lengths: each copy is one or two registers.
        self.rows[at..at + GROUP].copy_from_slice(&[row; GROUP]);
        self.starts[at..at + GROUP].copy_from_slice(group.starts);
        self.lanes[at..at + GROUP].copy_from_slice(group.lanes);
        self.len = at + group.count;
    }

    /// Forgets all strips.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Tests all strips: their lanes become the overlaps.
    pub fn test(&mut self, boxes: &OrderedBoxes, isa: AvailableIsa) {
        let (rows, starts, lanes) =
            (&self.rows[..self.len], &self.starts[..self.len], &mut self.lanes[..self.len]);
        self.compared += lanes.iter().map(|l| u64::from(l.count_ones())).sum::<u64>();
        let keys = boxes.keys();
        match isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512::test(&keys, rows, starts, lanes, isa),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => avx2::test(&keys, rows, starts, lanes, isa),
            _ => portable::test(&keys, rows, starts, lanes),
        }
    }

    /// Calls `take` with every strip that has an overlap, in order, less those it can do without a
    /// branch on.
    #[inline(always)]
    pub(super) fn for_each_hit(&self, mut take: impl FnMut(Hit)) {
        let mut hits = [0u16; BATCH_STRIPS];
        let mut hit_count = 0;
        for (i, &lanes) in self.lanes[..self.len].iter().enumerate() {
            hits[hit_count & (BATCH_STRIPS - 1)] = i as u16;
            hit_count += usize::from(lanes != 0);
        }
        for &i in &hits[..hit_count] {
            let i = usize::from(i) & (BATCH_STRIPS - 1);
            take(Hit { row: self.rows[i], start: self.starts[i], bits: self.lanes[i] });
        }
    }

    /// Strips with an overlap, or more.
    pub(super) fn len(&self) -> usize {
        self.len
    }
}

/// Whether a kernel may read the keys of all rows and 16 columns from all starts.
///
/// # Panics
/// When it may not: an engine has pushed a position that is none.
pub(super) fn check_bounds(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &[u16]) {
    let last = |positions: &[u32]| positions.iter().fold(0, |a: u32, &b| a.max(b)) as usize;
    let len = keys.iter().map(|k| k.len()).min().unwrap_or(0);
    assert!(rows.len() == starts.len() && rows.len() == lanes.len());
    assert!(rows.is_empty() || (last(rows) < len && last(starts) + STRIP_COLUMNS <= len));
}
