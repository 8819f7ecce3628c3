//! Sparse masks: non-zero words with their addresses.

use std::fmt;
use std::ops::Range;

use super::sparse_pairs::{Kernel, SparsePairs};
use super::sparse_words::SparseWords;
use crate::isa::AvailableIsa;
use crate::mask::{MaskError, MaskView, Section, Span};
use crate::units::BoxCount;

/// A sparse mask, lengths checked: see the [module's head](crate::mask).
#[derive(Clone, Copy)]
pub struct SparseMask<'a> {
    n: BoxCount,
    /// `rows`, `blocks` and `bits` are equally long.
    rows: &'a [u32],
    blocks: &'a [u32],
    bits: &'a [u32],
    /// `n` positions, where there is one.
    order: Option<&'a [u32]>,
    kernel: Kernel,
}

impl<'a> SparseMask<'a> {
    pub(super) fn new(
        n: BoxCount,
        [rows, blocks, bits]: [&Span; 3],
        order: Option<&Span>,
        reply: &'a [u32],
    ) -> Result<Self, MaskError> {
        if rows.len != blocks.len || rows.len != bits.len {
            let (rows, blocks, bits) = (rows.len, blocks.len, bits.len);
            return Err(MaskError::SectionLengths { rows, blocks, bits });
        }
        if let Some(order) = order.filter(|order| order.len != u64::from(n.get())) {
            return Err(MaskError::OrderLength { n: n.get(), found: order.len });
        }
        Ok(Self {
            n,
            rows: Section::Rows.of(rows, reply)?,
            blocks: Section::Blocks.of(blocks, reply)?,
            bits: Section::Bits.of(bits, reply)?,
            order: order.map(|order| Section::Order.of(order, reply)).transpose()?,
            kernel: Kernel::of(AvailableIsa::best(), order.is_some()),
        })
    }

    /// A mask of words that an engine of this process has found, with its order if it has one: the box
    /// at each of `n` positions. Arrays of different lengths are cut to the shortest.
    pub(crate) fn of_found(
        n: BoxCount,
        words: [&'a [u32]; 3],
        order: Option<&'a [u32]>,
        isa: AvailableIsa,
    ) -> Self {
        let len = words.map(<[u32]>::len).into_iter().min().unwrap_or(0);
        let [rows, blocks, bits] = words.map(|array| &array[..len]);
        let kernel = Kernel::of(isa, order.is_some());
        Self { n, rows, blocks, bits, order, kernel }
    }

    /// The same mask, decoded with one instruction set.
    pub(super) fn with_isa(self, isa: AvailableIsa) -> Self {
        Self { kernel: Kernel::of(isa, self.order.is_some()), ..self }
    }

    /// Number of boxes.
    #[inline]
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Number of words, malformed ones included.
    #[inline]
    pub const fn word_count(&self) -> usize {
        self.bits.len()
    }

    /// Box index at each position, or `None` where positions are box indices.
    #[inline]
    pub const fn order(&self) -> Option<&'a [u32]> {
        self.order
    }

    /// Whether the mask names the pair of boxes `a` and `b`, in any order of the two.
    ///
    /// A binary search by row and block; with an order, first an O(n) search for the positions of
    /// both boxes, so a caller with many questions walks the pairs once instead. False for equal and for
    /// unknown boxes. In a mask that `verify` rejects, a pair may go unfound.
    #[must_use]
    pub fn contains(&self, a: u32, b: u32) -> bool {
        if a == b || a.max(b) >= self.n.get() {
            return false;
        }
        let positions = match self.order {
            None => Some((a, b)),
            Some(order) => position_of(order, a).zip(position_of(order, b)),
        };
        positions.is_some_and(|(p, q)| self.names_positions(p.min(q), p.max(q)))
    }

    /// Whether the word of (row, column) has its bit.
    fn names_positions(&self, row: u32, column: u32) -> bool {
        let start = self.rows.partition_point(|r| *r < row);
        let len = self.rows.get(start..).map_or(0, |rows| rows.partition_point(|r| *r == row));
        self.blocks
            .get(start..start + len)
            .and_then(|blocks| blocks.binary_search(&(column / 32)).ok())
            .and_then(|i| self.bits.get(start + i))
            .is_some_and(|bits| bits & (1 << (column % 32)) != 0)
    }

    /// Number of pairs. Never less than the iterators give; more only if the order is malformed.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.words_in(0..self.bits.len())
            .fold(0, |sum, word| sum + u64::from(word.without_strays(self.n).bits.count_ones()))
    }

    /// Calls `f` with slices of pairs of boxes, in the order of the words.
    #[inline]
    pub(crate) fn for_each_slice(&self, f: impl FnMut(&[[u32; 2]])) {
        MaskView::Sparse(*self).for_each_slice(f);
    }

    /// The words of a range, strays included.
    pub(super) fn words_in(&self, range: Range<usize>) -> SparseWords<'a> {
        let of = |section: &'a [u32]| section.get(range.clone()).unwrap_or(&[]);
        SparseWords::new(of(self.rows), of(self.blocks), of(self.bits))
    }

    pub(super) fn pairs_in(&self, range: Range<usize>) -> SparsePairs<'a> {
        SparsePairs::new(self.n, self.order, self.words_in(range), self.kernel)
    }

    /// Checks every rule of the encoding.
    pub(super) fn verify(&self) -> Result<(), MaskError> {
        let blocks = self.n.column_blocks();
        let mut before = None;
        for (number, word) in (0u64..).zip(self.words_in(0..self.bits.len())) {
            let (row, block, strays) = (word.row, word.block, word.bits & !word.valid_mask(self.n));
            if word.bits == 0 {
                return Err(MaskError::ZeroWord { word: number });
            }
            if block >= blocks {
                return Err(MaskError::NoSuchBlock { word: number, block, blocks });
            }
            if strays != 0 {
                return Err(MaskError::NoSuchPair { word: number, row, bits: strays });
            }
            if before.replace((row, block)).is_some_and(|before| before >= (row, block)) {
                return Err(MaskError::NotSorted { word: number });
            }
        }
        self.order.map_or(Ok(()), |order| verify_permutation(self.n, order))
    }
}

/// First position of a box in an order.
fn position_of(order: &[u32], index: u32) -> Option<u32> {
    (0..).zip(order).find_map(|(position, at)| (*at == index).then_some(position))
}

/// Checks that `n` positions name each of `n` boxes once.
fn verify_permutation(n: BoxCount, order: &[u32]) -> Result<(), MaskError> {
    let mut seen = vec![false; order.len()];
    for (position, index) in (0..).zip(order.iter().copied()) {
        match seen.get_mut(index as usize) {
            None => return Err(MaskError::NoSuchBox { position, index, n: n.get() }),
            Some(true) => return Err(MaskError::BoxAgain { position, index }),
            Some(seen) => *seen = true,
        }
    }
    Ok(())
}

impl fmt::Debug for SparseMask<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SparseMask")
            .field("n", &self.n.get())
            .field("words", &self.bits.len())
            .field("ordered", &self.order.is_some())
            .finish()
    }
}
