//! A decoder of masks that follows their definition literally and checks every rule.
//!
//! It shares no code with the production decoder, so that both do not share a mistake.

use crate::mask::{MaskShape, SECTION_ALIGN_WORDS, Span};

use super::Pair;

/// The rule of its encoding that a mask breaks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadMask {
    /// A section reaches past the reserved words.
    #[error("section {0:?} lies outside the reply of {1} words")]
    OutOfReply(Span, usize),
    /// A section starts off the 64-byte grid.
    #[error("section {0:?} does not start on a multiple of 16 words")]
    Unaligned(Span),
    /// A dense mask that is not one bit a pair.
    #[error("a dense mask of {words} words for {pairs} pairs")]
    DenseSize {
        /// Words of the mask.
        words: u64,
        /// Pairs of the scene.
        pairs: u64,
    },
    /// Bits past the last pair of a dense mask.
    #[error("the tail of the dense mask is not zero: last word {0:#010x}")]
    DirtyTail(u32),
    /// The arrays of a sparse mask differ in length, or the order is not of n positions.
    #[error("the arrays of the sparse mask do not fit each other: {0:?}")]
    SparseSize(MaskShape),
    /// A sparse word without a set bit.
    #[error("sparse word {0} is zero")]
    ZeroWord(usize),
    /// Sparse words out of order, or one address twice.
    #[error("sparse word {0} does not come after the word before it")]
    Unsorted(usize),
    /// A bit of a sparse word in a column that does not exist, or is not after the row.
    #[error("sparse word {word}: row {row}, column {column} of {n}")]
    Column {
        /// The word.
        word: usize,
        /// Its row.
        row: u32,
        /// The column.
        column: u64,
        /// Number of positions.
        n: u32,
    },
    /// An order that has a box twice, or one that does not exist.
    #[error("the order is not a permutation: position {0} holds {1}")]
    Order(usize, u32),
    /// A list that ends with half a pair.
    #[error("a list of {0} words, two of which are a pair")]
    HalfPair(usize),
    /// An entry of a list that is no pair of the boxes, smaller index first.
    #[error("entry {number} of the list is {pair:?}, of {n} boxes")]
    NotAPair {
        /// The entry.
        number: usize,
        /// What stands there.
        pair: Pair,
        /// Number of boxes.
        n: u32,
    },
    /// A pair that the mask has twice.
    #[error("pair {0:?} is named twice")]
    Doubled(Pair),
}

/// The pairs of a mask of n boxes, sorted.
///
/// # Errors
/// [`BadMask`] when the mask breaks a rule of its encoding.
pub fn decode(reply: &[u32], shape: &MaskShape, n: u32) -> Result<Vec<Pair>, BadMask> {
    let mut pairs = match shape {
        MaskShape::Dense { words } => decode_dense(section(reply, words)?, n)?,
        MaskShape::Sparse { rows, blocks, bits, order } => {
            let order = match order {
                Some(order) => section(reply, order)?.to_vec(),
                None => (0..n).collect(),
            };
            check_permutation(&order, n, shape)?;
            if rows.len != bits.len || blocks.len != bits.len {
                return Err(BadMask::SparseSize(*shape));
            }
            let arrays = [section(reply, rows)?, section(reply, blocks)?, section(reply, bits)?];
            decode_sparse(arrays, &order)?
        }
        MaskShape::List { pairs } => decode_list(section(reply, pairs)?, n)?,
    };
    pairs.sort_unstable();
    match pairs.windows(2).find(|w| w[0] == w[1]) {
        Some(twice) => Err(BadMask::Doubled(twice[0])),
        None => Ok(pairs),
    }
}

/// The words of all sections, one section after the other: two runs must agree on them.
///
/// # Errors
/// [`BadMask`] when a section lies outside the reply.
pub fn sections(reply: &[u32], shape: &MaskShape) -> Result<Vec<u32>, BadMask> {
    let mut words = Vec::new();
    for span in shape.spans() {
        words.extend_from_slice(section(reply, &span)?);
    }
    Ok(words)
}

fn section<'a>(reply: &'a [u32], span: &Span) -> Result<&'a [u32], BadMask> {
    if !span.start.is_multiple_of(SECTION_ALIGN_WORDS) {
        return Err(BadMask::Unaligned(*span));
    }
    let (start, end) = (span.start as usize, span.start.saturating_add(span.len) as usize);
    reply.get(start..end).ok_or(BadMask::OutOfReply(*span, reply.len()))
}

fn decode_dense(words: &[u32], n: u32) -> Result<Vec<Pair>, BadMask> {
    let pair_count = (0..u64::from(n)).sum::<u64>();
    if words.len() as u64 != pair_count.div_ceil(32) {
        return Err(BadMask::DenseSize { words: words.len() as u64, pairs: pair_count });
    }
    if let Some(&last) = words.last() {
        let used = pair_count % 32;
        if used != 0 && last >> used != 0 {
            return Err(BadMask::DirtyTail(last));
        }
    }
    let mut pairs = Vec::new();
    let mut k = 0usize;
    for a in 0..n {
        for b in a + 1..n {
            if words[k / 32] >> (k % 32) & 1 == 1 {
                pairs.push([a, b]);
            }
            k += 1;
        }
    }
    Ok(pairs)
}

fn check_permutation(order: &[u32], n: u32, shape: &MaskShape) -> Result<(), BadMask> {
    if order.len() != n as usize {
        return Err(BadMask::SparseSize(*shape));
    }
    let mut seen = vec![false; order.len()];
    for (position, &index) in order.iter().enumerate() {
        match seen.get_mut(index as usize) {
            Some(slot) if !*slot => *slot = true,
            _ => return Err(BadMask::Order(position, index)),
        }
    }
    Ok(())
}

fn decode_sparse([rows, blocks, bits]: [&[u32]; 3], order: &[u32]) -> Result<Vec<Pair>, BadMask> {
    let n = order.len() as u32;
    let mut pairs = Vec::new();
    for word in 0..bits.len() {
        let (row, block) = (rows[word], blocks[word]);
        if bits[word] == 0 {
            return Err(BadMask::ZeroWord(word));
        }
        if word > 0 && (rows[word - 1], blocks[word - 1]) >= (row, block) {
            return Err(BadMask::Unsorted(word));
        }
        for bit in (0..32).filter(|t| bits[word] >> t & 1 == 1) {
            let column = u64::from(block) * 32 + bit;
            if column <= u64::from(row) || column >= u64::from(n) {
                return Err(BadMask::Column { word, row, column, n });
            }
            let (a, b) = (order[row as usize], order[column as usize]);
            pairs.push([a.min(b), a.max(b)]);
        }
    }
    Ok(pairs)
}

fn decode_list(words: &[u32], n: u32) -> Result<Vec<Pair>, BadMask> {
    if !words.len().is_multiple_of(2) {
        return Err(BadMask::HalfPair(words.len()));
    }
    let mut pairs = Vec::new();
    for number in 0..words.len() / 2 {
        let pair = [words[2 * number], words[2 * number + 1]];
        if pair[0] >= pair[1] || pair[1] >= n {
            return Err(BadMask::NotAPair { number, pair, n });
        }
        pairs.push(pair);
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::BoxCount;

    const N: u32 = 40;

    /// Rows 0 and 3 of 40 positions: pairs (0, 1), (0, 33), (3, 4).
    fn sparse() -> (Vec<u32>, MaskShape) {
        let shape = MaskShape::sparse(BoxCount::new(N), 3, 3, false);
        let mut reply = vec![0; 48];
        reply[..3].copy_from_slice(&[0, 0, 3]);
        reply[16..19].copy_from_slice(&[0, 1, 0]);
        reply[32..35].copy_from_slice(&[0b10, 0b10, 0b1_0000]);
        (reply, shape)
    }

    fn spoilt(spoil: impl FnOnce(&mut Vec<u32>)) -> Result<Vec<Pair>, BadMask> {
        let (mut reply, shape) = sparse();
        spoil(&mut reply);
        decode(&reply, &shape, N)
    }

    #[test]
    fn a_good_sparse_mask_decodes() {
        assert_eq!(spoilt(|_| {}), Ok(vec![[0, 1], [0, 33], [3, 4]]));
    }

    #[test]
    fn every_sparse_rule_can_be_broken() {
        assert_eq!(spoilt(|r| r[33] = 0), Err(BadMask::ZeroWord(1)));
        assert_eq!(spoilt(|r| r[17] = 0), Err(BadMask::Unsorted(1)));
        assert_eq!(spoilt(|r| r[1] = 4), Err(BadMask::Unsorted(2)));
        let column = |word, row, column| Err(BadMask::Column { word, row, column, n: N });
        assert_eq!(spoilt(|r| r[32] = 0b11), column(0, 0, 0));
        assert_eq!(spoilt(|r| r[33] = 0b1_0000_0010), column(1, 0, 40));
        assert_eq!(spoilt(|r| r[17] = 9), column(1, 0, 289));
        assert!(matches!(spoilt(|r| r.truncate(34)), Err(BadMask::OutOfReply(..))));
    }

    #[test]
    fn an_order_must_be_a_permutation_and_may_name_a_pair_once() {
        let shape = MaskShape::sparse(BoxCount::new(3), 2, 2, true);
        let mut reply = vec![0; 51];
        reply[..2].copy_from_slice(&[0, 1]);
        reply[32..34].copy_from_slice(&[0b110, 0b100]);
        reply[48..].copy_from_slice(&[2, 0, 1]);
        assert_eq!(decode(&reply, &shape, 3), Ok(vec![[0, 1], [0, 2], [1, 2]]));
        reply[50] = 0;
        assert_eq!(decode(&reply, &shape, 3), Err(BadMask::Order(2, 0)));
        reply[50] = 3;
        assert_eq!(decode(&reply, &shape, 3), Err(BadMask::Order(2, 3)));
    }

    #[test]
    fn dense_size_and_tail_are_checked() {
        let shape = MaskShape::dense(BoxCount::new(4));
        assert_eq!(decode(&[0b10_0001], &shape, 4), Ok(vec![[0, 1], [2, 3]]));
        assert_eq!(decode(&[0b100_0001], &shape, 4), Err(BadMask::DirtyTail(0b100_0001)));
        let wrong = BadMask::DenseSize { words: 1, pairs: 36 };
        assert_eq!(decode(&[0], &shape, 9), Err(wrong));
    }

    #[test]
    fn every_rule_of_a_list_can_be_broken() {
        let list = |words: &[u32]| {
            let pairs = Span { start: 0, len: words.len() as u64 };
            decode(words, &MaskShape::List { pairs }, N)
        };
        assert_eq!(list(&[]), Ok(vec![]));
        assert_eq!(list(&[3, 4, 0, 33, 0, 1]), Ok(vec![[0, 1], [0, 33], [3, 4]]));
        assert_eq!(list(&[3, 4, 0]), Err(BadMask::HalfPair(3)));
        let no_pair = |number, pair| Err(BadMask::NotAPair { number, pair, n: N });
        assert_eq!(list(&[3, 4, 7, 7]), no_pair(1, [7, 7]));
        assert_eq!(list(&[3, 4, 8, 7]), no_pair(1, [8, 7]));
        assert_eq!(list(&[3, 40, 7, 8]), no_pair(0, [3, 40]));
        assert_eq!(list(&[3, 4, 0, 33, 3, 4]), Err(BadMask::Doubled([3, 4])));
    }

    #[test]
    fn sections_start_on_cache_lines() {
        let span = Span { start: 8, len: 1 };
        let shape = MaskShape::Dense { words: span };
        assert_eq!(decode(&[0; 16], &shape, 2), Err(BadMask::Unaligned(span)));
    }
}
