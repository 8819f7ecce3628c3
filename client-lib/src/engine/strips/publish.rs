//! The words of all tasks, in their order, into the reply: sparse or dense.

use super::WordSink;
use super::sink::SparseWord;
use crate::engine::{CullError, ReplyBuffer};
use crate::mask::{Encoding, MaskShape};
use crate::units::BoxCount;

/// Fewest words that are worth a second thread.
const PARALLEL_WORDS: usize = 16 * 1024;

/// Writes the mask and says where it lies.
///
/// `sinks` hold the words of rising, disjoint ranges of rows; `order` the box index at each
/// position.
///
/// # Errors
/// [`CullError::Reserve`] when the reply has no room.
pub(crate) fn publish<'a, S>(
    sinks: S,
    order: &[u32],
    encoding: Encoding,
    parallel: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    S: Iterator<Item = &'a WordSink> + Clone + Send,
{
    let n = BoxCount::new(order.len() as u32);
    match encoding {
        Encoding::Sparse => publish_sparse(sinks, n, order, parallel, reply),
        Encoding::Dense => publish_dense(sinks, n, order, reply),
    }
}

fn publish_sparse<'a, S>(
    sinks: S,
    n: BoxCount,
    order: &[u32],
    parallel: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    S: Iterator<Item = &'a WordSink> + Clone + Send,
{
    let word_count = sinks.clone().map(|s| s.words().len() as u64).sum();
    let shape = MaskShape::sparse(n, word_count, word_count, true);
    let out = reply.reserve(shape.extent_words())?;
    let stride = match shape {
        MaskShape::Sparse { blocks, .. } => blocks.start as usize,
        MaskShape::Dense { .. } => 0,
    };
    let (rows, rest) = out.split_at_mut(stride);
    let (blocks, rest) = rest.split_at_mut(stride);
    let (bits, rest) = rest.split_at_mut(stride);
    let parallel = parallel && word_count as usize + order.len() >= PARALLEL_WORDS;
    let mut write_order = || rest[..order.len()].copy_from_slice(order);
    if parallel {
        rayon::join(
            || {
                let mut rest = (rows, blocks, bits);
                for sink in sinks {
                    rest = copy_split(sink.words(), rest);
                }
            },
            write_order,
        );
    } else {
        let mut rest = (rows, blocks, bits);
        for sink in sinks {
            rest = copy_words(sink.words(), rest);
        }
        write_order();
    }
    Ok(shape)
}

/// The three arrays of the reply that are still to be written.
type Arrays<'a> = (&'a mut [u32], &'a mut [u32], &'a mut [u32]);

#[allow(clippy::needless_pass_by_value)] // the borrows are consumed
fn split(arrays: Arrays<'_>, at: usize) -> (Arrays<'_>, Arrays<'_>) {
    let (rows, later_rows) = arrays.0.split_at_mut(at);
    let (blocks, later_blocks) = arrays.1.split_at_mut(at);
    let (bits, later_bits) = arrays.2.split_at_mut(at);
    ((rows, blocks, bits), (later_rows, later_blocks, later_bits))
}

fn copy_words<'a>(words: &[SparseWord], arrays: Arrays<'a>) -> Arrays<'a> {
    let (here, later) = split(arrays, words.len());
    for (((word, row), block), bits) in words.iter().zip(here.0).zip(here.1).zip(here.2) {
        *row = word.row;
        *block = word.block;
        *bits = word.bits;
    }
    later
}

/// [`copy_words`] in halves on two threads.
fn copy_split<'a>(words: &[SparseWord], arrays: Arrays<'a>) -> Arrays<'a> {
    if words.len() < PARALLEL_WORDS {
        return copy_words(words, arrays);
    }
    let (low, high) = words.split_at(words.len() / 2);
    let (low_arrays, rest) = split(arrays, low.len());
    let (high_arrays, later) = split(rest, high.len());
    rayon::join(|| copy_split(low, low_arrays), || copy_split(high, high_arrays));
    later
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
    for word in sinks.flat_map(WordSink::words) {
        let row = u64::from(order[word.row as usize]);
        let mut rest = word.bits;
        while rest != 0 {
            let position = 32 * word.block as usize + rest.trailing_zeros() as usize;
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
