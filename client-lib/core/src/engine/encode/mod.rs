//! Words to masks: what the tasks of a frame found, written into the reply in an encoding.
//!
//! Engines know words alone: non-zero, by rising row and column block. [`write`] makes a mask of any
//! encoding from those of all tasks. A dense mask, in which a range of rows has words of its own, can be
//! written while the rows are searched, without keeping what is found: [`DenseRows`].

mod dense;
mod list;
mod sparse;

pub(crate) use dense::{DenseRows, DenseWindow};

use super::gather::Gather;
use super::strips::WordSink;
use super::word_budget::WordBudget;
use super::{AvailableIsa, CostTerm, CullError, PairRules, ReplyBuffer};
use crate::mask::{Encoding, MaskShape};
use crate::stats::SceneStats;
use crate::units::BoxCount;

/// An encoding's share of the plan's cost model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EncodingCost {
    /// From the words that an engine of the CPU found to the mask. The engine's threads share it.
    pub write: &'static [CostTerm],
    /// From the mask to each pair in the client's hands. The client's threads share it.
    pub iterate: &'static [CostTerm],
    /// Bytes of the mask, of an engine that has an order of its own or not.
    pub bytes: fn(&SceneStats, bool) -> f64,
}

/// What the masks of an encoding take.
pub(crate) const fn encoding_cost(encoding: Encoding) -> &'static EncodingCost {
    match encoding {
        Encoding::Dense => &dense::COST,
        Encoding::Sparse => &sparse::COST,
        Encoding::List => &list::COST,
    }
}

/// The words that a task found: non-zero, sorted by (row, block), each address once.
pub(crate) trait FoundWords: Sync {
    /// Rows, blocks and bits, some words at a time.
    fn chunks(&self) -> impl Iterator<Item = [&[u32]; 3]>;

    fn word_count(&self) -> usize {
        self.chunks().map(|[_, _, bits]| bits.len()).sum()
    }

    /// Set bits of these words.
    fn pair_count(&self) -> u64;
}

/// Writes the mask and says where it lies.
///
/// `tasks` hold the words of rising, disjoint ranges of rows, which they gathered by `gather`. With
/// `parallel`, the rayon pool of this thread takes part where there is enough to write.
///
/// # Errors
/// [`CullError::Reserve`] when the reply has no room: the words are then not all. [`CullError::Cancelled`].
pub(crate) fn write<'a, W, T>(
    tasks: T,
    gather: &Gather<'_>,
    encoding: Encoding,
    parallel: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    W: FoundWords + 'a,
    T: Iterator<Item = &'a W> + Clone + Send + Sync,
{
    gather.budget.check()?;
    let shape = match encoding {
        Encoding::Dense => dense::write(tasks, gather, reply),
        Encoding::Sparse => sparse::write(&tasks, gather, parallel, reply),
        Encoding::List => list::write(&tasks, gather, parallel, reply),
    }?;
    gather.budget.check()?;
    Ok(shape)
}

/// Writes the mask of `n` boxes, in their own order, of which no two overlap.
///
/// # Errors
/// [`CullError::Reserve`] when the reply has no room.
pub fn write_no_pairs(
    n: BoxCount,
    encoding: Encoding,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError> {
    let budget = &WordBudget::new(n, encoding, false, reply)?;
    let isa = AvailableIsa::best();
    let gather = &Gather { budget, rules: PairRules::NONE, order: &[], isa, keeps: true };
    write(std::iter::empty::<&WordSink>(), gather, encoding, false, reply)
}
