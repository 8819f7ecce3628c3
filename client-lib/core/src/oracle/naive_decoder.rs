//! A decoder of masks that follows their definition literally and checks every rule.
//!
//! It shares no code with the production decoder, so that both do not share a mistake.

use super::Pair;
use crate::mask::{MaskError, MaskShape, Section, Span};

/// The pairs of a mask of n boxes, sorted.
///
/// # Errors
/// [`MaskError`] when the mask breaks a rule of its encoding.
pub fn decode(reply: &[u32], shape: &MaskShape, n: u32) -> Result<Vec<Pair>, MaskError> {
    let mut pairs = match shape {
        MaskShape::Dense { words } => decode_dense(section(reply, words, Section::Words)?, n)?,
        MaskShape::Sparse { rows, blocks, bits, order } => {
            let order = match order {
                Some(order) => section(reply, order, Section::Order)?.to_vec(),
                None => (0..n).collect(),
            };
            check_permutation(&order, n)?;
            if rows.len != bits.len || blocks.len != bits.len {
                let (rows, blocks, bits) = (rows.len, blocks.len, bits.len);
                return Err(MaskError::SectionLengths { rows, blocks, bits });
            }
            let rows = section(reply, rows, Section::Rows)?;
            let blocks = section(reply, blocks, Section::Blocks)?;
            decode_sparse([rows, blocks, section(reply, bits, Section::Bits)?], &order)?
        }
        MaskShape::List { pairs } => decode_list(section(reply, pairs, Section::Pairs)?, n)?,
    };
    pairs.sort_unstable();
    match pairs.windows(2).find(|w| w[0] == w[1]) {
        Some(&[[a, b], _]) => Err(MaskError::PairAgain { a, b }),
        _ => Ok(pairs),
    }
}

/// The words of all sections, one section after the other: two runs must agree on them. `None`
/// when one lies outside the reply.
pub fn sections(reply: &[u32], shape: &MaskShape) -> Option<Vec<u32>> {
    let mut words = Vec::new();
    for span in shape.spans() {
        words.extend_from_slice(within(reply, &span)?);
    }
    Some(words)
}

fn within<'a>(reply: &'a [u32], span: &Span) -> Option<&'a [u32]> {
    reply.get(span.start as usize..span.start.saturating_add(span.len) as usize)
}

fn section<'a>(reply: &'a [u32], span: &Span, section: Section) -> Result<&'a [u32], MaskError> {
    let reply_words = reply.len() as u64;
    within(reply, span).ok_or(MaskError::OutsideReply { section, span: *span, reply_words })
}

fn decode_dense(words: &[u32], n: u32) -> Result<Vec<Pair>, MaskError> {
    let pair_count = (0..u64::from(n)).sum::<u64>();
    let (expected, found) = (pair_count.div_ceil(32), words.len() as u64);
    if found != expected {
        return Err(MaskError::DenseLength { n, expected, found });
    }
    if let Some(&bits) = words.last() {
        let used = pair_count % 32;
        if used != 0 && bits >> used != 0 {
            return Err(MaskError::TailBits { bits });
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

fn check_permutation(order: &[u32], n: u32) -> Result<(), MaskError> {
    if order.len() != n as usize {
        return Err(MaskError::OrderLength { n, found: order.len() as u64 });
    }
    let mut seen = vec![false; order.len()];
    for (position, &index) in (0..).zip(order) {
        match seen.get_mut(index as usize) {
            Some(slot) if !*slot => *slot = true,
            Some(_) => return Err(MaskError::BoxAgain { position, index }),
            None => return Err(MaskError::NoSuchBox { position, index, n }),
        }
    }
    Ok(())
}

fn decode_sparse([rows, blocks, bits]: [&[u32]; 3], order: &[u32]) -> Result<Vec<Pair>, MaskError> {
    let n = order.len() as u64;
    let mut pairs = Vec::new();
    for at in 0..bits.len() {
        let (row, block, word) = (rows[at], blocks[at], at as u64);
        if bits[at] == 0 {
            return Err(MaskError::ZeroWord { word });
        }
        if at > 0 && (rows[at - 1], blocks[at - 1]) >= (row, block) {
            return Err(MaskError::NotSorted { word });
        }
        for bit in (0..32).filter(|t| bits[at] >> t & 1 == 1) {
            let column = u64::from(block) * 32 + bit;
            if column <= u64::from(row) || column >= n {
                return Err(MaskError::NoSuchPair { word, row, bits: 1 << bit });
            }
            let (a, b) = (order[row as usize], order[column as usize]);
            pairs.push([a.min(b), a.max(b)]);
        }
    }
    Ok(pairs)
}

fn decode_list(words: &[u32], n: u32) -> Result<Vec<Pair>, MaskError> {
    if !words.len().is_multiple_of(2) {
        return Err(MaskError::HalfPair { words: words.len() as u64 });
    }
    let mut pairs = Vec::new();
    for at in 0..words.len() / 2 {
        let [a, b] = [words[2 * at], words[2 * at + 1]];
        if a >= b || b >= n {
            return Err(MaskError::NotAPair { number: at as u64, a, b, n });
        }
        pairs.push([a, b]);
    }
    Ok(pairs)
}
