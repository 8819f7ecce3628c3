//! The words of all tasks, in their order, into the reply: sparse or dense.

use super::{WordSink, in_parts};
use crate::engine::gather::Gather;
use crate::engine::{CullError, ReplyBuffer};
use crate::mask::{Encoding, MaskShape};
use crate::units::BoxCount;

/// Fewest words that are worth a second thread.
const PARALLEL_WORDS: usize = 16 * 1024;

/// Writes the mask and says where it lies.
///
/// `sinks` hold the words of rising, disjoint ranges of rows, which they gathered by `gather`.
///
/// # Errors
/// [`CullError::Reserve`] when the reply has no room: the words are then not all.
pub(crate) fn publish<'a, S>(
    sinks: S,
    gather: &Gather<'_>,
    encoding: Encoding,
    parallel: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    S: Iterator<Item = &'a WordSink> + Clone + Send + Sync,
{
    gather.budget.check()?;
    let order = gather.order;
    let n = BoxCount::new(order.len() as u32);
    match encoding {
        Encoding::Sparse => publish_sparse(&sinks, n, order, parallel, reply),
        Encoding::Dense => publish_dense(sinks, n, order, reply),
    }
}

fn publish_sparse<'a, S>(
    sinks: &S,
    n: BoxCount,
    order: &[u32],
    parallel: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    S: Iterator<Item = &'a WordSink> + Clone + Send + Sync,
{
    let word_count = sinks.clone().map(|s| s.word_count() as u64).sum();
    let shape = MaskShape::sparse(n, word_count, word_count, true);
    let out = reply.reserve(shape.extent_words())?;
    let stride = match shape {
        MaskShape::Sparse { blocks, .. } => blocks.start as usize,
        MaskShape::Dense { .. } => 0,
    };
    let (rows, rest) = out.split_at_mut(stride);
    let (blocks, rest) = rest.split_at_mut(stride);
    let (bits, rest) = rest.split_at_mut(stride);
    let mut jobs = [
        (Section::Words(0), rows),
        (Section::Words(1), blocks),
        (Section::Words(2), bits),
        (Section::Order, &mut rest[..order.len()]),
    ];
    let write = |jobs: &mut [(Section, &mut [u32])]| {
        for (section, out) in jobs {
            match section {
                Section::Words(array) => copy_words(sinks.clone(), *array, out),
                Section::Order => out.copy_from_slice(order),
            }
        }
    };
    let parallel = parallel && word_count as usize + order.len() >= PARALLEL_WORDS;
    let parts = if parallel { jobs.len() } else { 1 };
    in_parts(jobs.as_mut_slice(), parts, &write, &|(), ()| ());
    Ok(shape)
}

/// A section of the reply.
enum Section {
    /// One of the three arrays of words.
    Words(usize),
    /// The order of the boxes.
    Order,
}

/// One of the three arrays of all sinks' words.
fn copy_words<'a>(sinks: impl Iterator<Item = &'a WordSink>, array: usize, out: &mut [u32]) {
    let mut rest = out;
    for words in sinks.flat_map(WordSink::words).map(|arrays| arrays[array]) {
        let (here, later) = rest.split_at_mut(words.len());
        here.copy_from_slice(words);
        rest = later;
    }
}

/// Sets each pair's bit. The words of a dense mask are in box order and those of the sinks are
/// not, so this writes all over the mask: right, and slower than `cpu-brute` where dense is asked
/// for, which is why the plan never pairs the two.
fn publish_dense<'a, S>(
    sinks: S,
    n: BoxCount,
    order: &[u32],
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    S: Iterator<Item = &'a WordSink>,
{
    let shape = MaskShape::dense(n);
    let extent = shape.extent_words();
    let mask = &mut reply.reserve(extent)?[..extent as usize];
    mask.fill(0);
    let words = sinks.flat_map(WordSink::words).flat_map(|[rows, blocks, bits]| {
        rows.iter().zip(blocks).zip(bits).map(|((row, block), bits)| (*row, *block, *bits))
    });
    for (row, block, bits) in words {
        let row = u64::from(order[row as usize]);
        let mut rest = bits;
        while rest != 0 {
            let position = 32 * block as usize + rest.trailing_zeros() as usize;
            let column = u64::from(order[position]);
            let (a, b) = (row.min(column), row.max(column));
            // k = a(2n − a − 1)/2 + (b − a − 1), design.md §3.
            let k = a * (2 * u64::from(n.get()) - a - 1) / 2 + (b - a - 1);
            mask[(k / 32) as usize] |= 1 << (k % 32);
            rest &= rest - 1;
        }
    }
    Ok(shape)
}
