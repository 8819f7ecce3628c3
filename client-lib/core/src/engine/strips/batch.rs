//! A batch of strips and the kernels that test it.

use super::ordered::{KeyArrays, OrderedBoxes};
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// Columns of a strip: the lanes of an AVX-512 register.
pub(crate) const STRIP_COLUMNS: usize = 16;

/// Strips tested at a time: 10 KiB of addresses and answers, which with the keys of a few hundred
/// rows stay in the first-level cache.
pub(crate) const BATCH_STRIPS: usize = 1024;

/// Strips that [`StripBatch::push_group`] copies at a time, needed or not.
pub(crate) const GROUP: usize = 8;

/// Room for the copies of the last group that were not needed, and for a register that is loaded whole.
const ALLOCATED: usize = BATCH_STRIPS + STRIP_COLUMNS;

/// Strips of a row that are the same for all rows of a cell.
pub(crate) struct StripGroup<'a> {
    pub starts: &'a [u32; GROUP],
    pub lanes: &'a [u16; GROUP],
    /// How many of them are needed: the first ones.
    pub count: usize,
}

/// Strips to be tested: addresses in, hit bits out. Rows and starts must rise.
pub(crate) struct StripBatch {
    rows: Box<[u32; ALLOCATED]>,
    starts: Box<[u32; ALLOCATED]>,
    /// Before the test the columns that belong to the run, after it those of them that overlap.
    lanes: Box<[u16; ALLOCATED]>,
    len: usize,
    /// Columns compared by the last test.
    tested: u64,
}

/// The arrays of a batch by themselves, and where the next strip goes: a loop that pushes keeps these in
/// registers.
pub(crate) struct StripSlots<'a> {
    rows: &'a mut [u32; ALLOCATED],
    starts: &'a mut [u32; ALLOCATED],
    lanes: &'a mut [u16; ALLOCATED],
    len: usize,
}

impl StripSlots<'_> {
    /// Strips that can still be pushed.
    #[inline(always)]
    pub fn room(&self) -> usize {
        BATCH_STRIPS.saturating_sub(self.len)
    }

    /// See [`StripBatch::push`].
    #[inline(always)]
    pub fn push(&mut self, row: u32, start: u32, end: u32) -> u32 {
        let count = end.saturating_sub(start).min(STRIP_COLUMNS as u32);
        let at = self.len.min(BATCH_STRIPS);
        self.rows[at] = row;
        self.starts[at] = start;
        self.lanes[at] = ((1u32 << count) - 1) as u16;
        self.len = at + usize::from(count != 0);
        start + count
    }

    /// Adds a strip, if it has lanes, and those of a group behind it: [`GROUP`] at most, of one row. There
    /// must be more room than for them.
    #[inline(always)]
    pub fn push_row(&mut self, row: u32, start: u32, lanes: u16, group: &StripGroup<'_>) {
        let at = self.len % BATCH_STRIPS;
        self.rows[at..at + GROUP].copy_from_slice(&[row; GROUP]);
        (self.starts[at], self.lanes[at]) = (start, lanes);
        let at = at + usize::from(lanes != 0);
        self.starts[at..at + GROUP].copy_from_slice(group.starts);
        self.lanes[at..at + GROUP].copy_from_slice(group.lanes);
        self.len = at + group.count;
    }

    /// See [`StripBatch::push_group`].
    #[inline(always)]
    pub fn push_group(&mut self, row: u32, group: &StripGroup<'_>) {
        let at = self.len.min(BATCH_STRIPS);
        // Fixed lengths: each copy is one or two registers.
        self.rows[at..at + GROUP].copy_from_slice(&[row; GROUP]);
        self.starts[at..at + GROUP].copy_from_slice(group.starts);
        self.lanes[at..at + GROUP].copy_from_slice(group.lanes);
        self.len = at + group.count;
    }
}

impl Default for StripBatch {
    fn default() -> Self {
        Self {
            rows: Box::new([0; ALLOCATED]),
            starts: Box::new([0; ALLOCATED]),
            lanes: Box::new([0; ALLOCATED]),
            len: 0,
            tested: 0,
        }
    }
}

impl StripBatch {
    /// Strips that can still be pushed.
    #[inline(always)]
    pub fn room(&self) -> usize {
        BATCH_STRIPS - self.len
    }

    /// Adds the strip of the first columns of `start..end`, and returns where the next one starts.
    /// An empty run costs no strip and no branch. There must be [`Self::room`].
    #[inline(always)]
    pub fn push(&mut self, row: u32, start: u32, end: u32) -> u32 {
        self.push_all(|slots| slots.push(row, start, end))
    }

    /// Adds up to [`GROUP`] strips at the price of two. There must be [`Self::room`] for them.
    #[inline(always)]
    pub fn push_group(&mut self, row: u32, group: &StripGroup<'_>) {
        self.push_all(|slots| slots.push_group(row, group));
    }

    /// Has `push` add strips. There must be [`Self::room`] for all of them.
    #[inline(always)]
    pub fn push_all<R>(&mut self, push: impl FnOnce(&mut StripSlots<'_>) -> R) -> R {
        let Self { rows, starts, lanes, len, .. } = self;
        let mut slots = StripSlots { rows, starts, lanes, len: *len };
        let pushed = push(&mut slots);
        *len = slots.len;
        pushed
    }

    /// Whether there is no strip.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Drops all strips.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Tests all strips: their lanes become the overlaps. Returns the columns compared.
    pub fn test(&mut self, boxes: &OrderedBoxes, isa: AvailableIsa) -> u64 {
        let (rows, starts, lanes) =
            (&self.rows[..self.len], &self.starts[..self.len], &mut self.lanes[..self.len]);
        let keys = boxes.keys();
        self.tested = test(&keys, rows, starts, lanes, isa);
        self.tested
    }

    /// Columns that the last test compared.
    pub(super) const fn tested_columns(&self) -> u64 {
        self.tested
    }

    /// Rows, starts and lanes of all strips, and of as many behind the last one as a register holds.
    pub(super) fn arrays(&self) -> (&[u32], &[u32], &[u16]) {
        (&*self.rows, &*self.starts, &*self.lanes)
    }

    pub fn allocated_bytes(&self) -> usize {
        size_of_val(&*self.rows) + size_of_val(&*self.starts) + size_of_val(&*self.lanes)
    }

    pub(super) const fn len(&self) -> usize {
        self.len
    }
}

per_isa! {
    /// Of the `lanes` of each strip, those whose columns overlap its row. Returns the columns compared.
    pub(super) fn test<simd: S>(
        keys: &KeyArrays<'_>,
        rows: &[u32],
        starts: &[u32],
        lanes: &mut [u16],
    ) -> u64 {
        check_bounds(keys, rows, starts, lanes);
        let compared = count_columns(lanes);
        let keys = keys.map(<[i32]>::as_ptr);
        for ((&row, &start), lanes) in rows.iter().zip(starts).zip(lanes) {
            let (row, start) = (row as usize, start as usize);
            for first in (0..STRIP_COLUMNS).step_by(S::LANES) {
                let mut met = simd.all_meet();
                for axis in 0..3 {
                    // SAFETY: `check_bounds` has seen that every row and 16 columns from every start are
                    // in the arrays.
                    let (columns, of_row) = unsafe {
                        let at = start + first;
                        let (min, max) = (keys[axis].add(at), keys[3 + axis].add(at));
                        let columns = [simd.load_from(min), simd.load_from(max)];
                        let (min, max) = (keys[axis].add(row), keys[3 + axis].add(row));
                        (columns, [simd.splat(*min), simd.splat(*max)])
                    };
                    met = simd.meet(met, columns, of_row);
                }
                let others = !(((1u32 << S::LANES) - 1) << first);
                *lanes &= (simd.met_bits(met) << first | others) as u16;
            }
        }
        compared
    }
}

/// Whether a kernel may read the keys of all rows and 16 columns from all starts.
///
/// # Panics
/// When it may not: an engine has pushed a position that is none.
#[inline(always)]
pub(super) fn check_bounds(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &[u16]) {
    let last = |positions: &[u32]| positions.iter().fold(0, |a: u32, &b| a.max(b)) as usize;
    let len = keys.iter().map(|k| k.len()).min().unwrap_or(0);
    assert!(rows.len() == starts.len() && rows.len() == lanes.len());
    assert!(rows.is_empty() || (last(rows) < len && last(starts) + STRIP_COLUMNS <= len));
}

/// Columns of all strips before the test.
#[inline(always)]
pub(super) fn count_columns(lanes: &[u16]) -> u64 {
    let (fours, rest) = lanes.as_chunks::<4>();
    let fours = fours.iter().map(|lanes| {
        let bits = lanes.iter().rev().fold(0u64, |bits, lanes| bits << 16 | u64::from(*lanes));
        u64::from(bits.count_ones())
    });
    fours.sum::<u64>() + rest.iter().map(|lanes| u64::from(lanes.count_ones())).sum::<u64>()
}
