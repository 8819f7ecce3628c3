//! A sparse mask that keeps its rules, apart from the reply that it lay in.

use pairmask::mask::{MaskError, WordAddress};
use pairmask::{BoxCount, MaskView};

use super::sink::PairSink;

/// Why a mask cannot be studied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CopyError {
    /// It breaks a rule of its encoding.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// It is dense: there are no words with addresses.
    #[error("the mask is dense, and only words of sparse masks have forms: cull with a sparse one")]
    Dense,
}

/// A sparse mask: words that are sorted by (row, block), none of them zero, no bit of them without
/// a pair; and an order that names each box once.
///
/// It is the sparse form itself, and the input of all other forms.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskCopy {
    n: BoxCount,
    pub(super) rows: Vec<u32>,
    pub(super) blocks: Vec<u32>,
    pub(super) bits: Vec<u32>,
    order: Option<Vec<u32>>,
}

impl MaskCopy {
    /// Copies a mask.
    ///
    /// # Errors
    /// [`CopyError`] where it is no sparse mask that keeps every rule.
    pub fn of(mask: &MaskView<'_>) -> Result<Self, CopyError> {
        let MaskView::Sparse(sparse) = mask else { return Err(CopyError::Dense) };
        mask.verify()?;
        let order = sparse.order().map(<[u32]>::to_vec);
        let (mut rows, mut blocks, mut bits) = (Vec::new(), Vec::new(), Vec::new());
        for word in mask.words() {
            // A sparse mask has no other addresses.
            if let WordAddress::Sparse { row, block } = word.address {
                rows.push(row);
                blocks.push(block);
                bits.push(word.bits.0);
            }
        }
        Ok(Self { n: mask.n(), rows, blocks, bits, order })
    }

    /// Number of boxes.
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Box index at each position, or `None` where positions are box indices.
    pub fn order(&self) -> Option<&[u32]> {
        self.order.as_deref()
    }

    /// Number of words.
    pub fn word_count(&self) -> u64 {
        self.bits.len() as u64
    }

    /// Row, block and bits of each word.
    pub(super) fn words(&self) -> impl Iterator<Item = (u32, u32, u32)> {
        let addresses = self.rows.iter().zip(&self.blocks);
        addresses.zip(&self.bits).map(|((row, block), bits)| (*row, *block, *bits))
    }

    /// Bytes of the words.
    pub(super) fn word_bytes(&self) -> u64 {
        12 * self.word_count()
    }

    /// Puts every word.
    #[inline(always)]
    pub(super) fn walk<F: FnMut(u32, u32)>(&self, sink: &mut PairSink<'_, F>) {
        for (row, block, bits) in self.words() {
            sink.put_word(row, block.saturating_mul(32), u64::from(bits));
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask::mask::MaskShape;

    use super::*;

    #[test]
    fn only_sparse_masks_that_keep_the_rules_are_copied() {
        let n = BoxCount::new(4);
        let dense = [0];
        let view = MaskView::new(n, &MaskShape::dense(n), &dense).expect("one word");
        assert_eq!(MaskCopy::of(&view), Err(CopyError::Dense));
        // Bit 1 of row 1 is the box itself.
        let mut reply = [0; 33];
        (reply[0], reply[32]) = (1, 0b10);
        let shape = MaskShape::sparse(n, 1, 1, false);
        let view = MaskView::new(n, &shape, &reply).expect("one word");
        assert!(matches!(MaskCopy::of(&view), Err(CopyError::Mask(MaskError::NoSuchPair { .. }))));
        reply[32] = 0b100;
        let view = MaskView::new(n, &shape, &reply).expect("one word");
        let copy = MaskCopy::of(&view).expect("a mask that keeps the rules");
        assert_eq!(copy.words().collect::<Vec<_>>(), [(1, 0, 0b100)]);
        assert_eq!((copy.word_bytes(), copy.order()), (12, None));
    }
}
