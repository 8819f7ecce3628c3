//! The rules of a list: each pair is one of the boxes, smaller index first, and stands there once.

use super::is_pair;
use crate::mask::MaskError;
use crate::units::BoxCount;

/// Checks every rule.
///
/// Pairs are put into buckets by their smaller index, about one a bucket, so that the time grows with
/// the length of the list and the memory is twice the list's, for any `n`.
pub(super) fn verify(n: BoxCount, list: &[[u32; 2]]) -> Result<(), MaskError> {
    // A copy: another process may write to the list between two looks at it.
    let pairs = list.to_vec();
    let no_pair = (0u64..).zip(&pairs).find(|(_, pair)| !is_pair(**pair, n));
    if let Some((number, &[a, b])) = no_pair {
        return Err(MaskError::NotAPair { number, a, b, n: n.get() });
    }
    match first_again(n, &pairs) {
        Some([a, b]) => Err(MaskError::PairAgain { a, b }),
        None => Ok(()),
    }
}

/// The smallest pair that stands there twice.
fn first_again(n: BoxCount, pairs: &[[u32; 2]]) -> Option<[u32; 2]> {
    // At most n < 2^32, so that the product below is one of u64.
    let buckets = pairs.len().min(n.len());
    // Rises with the smaller index.
    let bucket_of = |[a, _]: [u32; 2]| u64::from(a) * buckets as u64 / u64::from(n.get());
    let bucket_of = |pair| bucket_of(pair) as usize;
    let mut ends = vec![0usize; buckets + 1];
    for pair in pairs {
        ends[bucket_of(*pair) + 1] += 1;
    }
    for bucket in 1..=buckets {
        ends[bucket] += ends[bucket - 1];
    }
    let mut placed = vec![[0; 2]; pairs.len()];
    for pair in pairs {
        // What was the start of a bucket is its end when all of its pairs are placed.
        let next = &mut ends[bucket_of(*pair)];
        placed[*next] = *pair;
        *next += 1;
    }
    let mut start = 0;
    ends[..buckets].iter().find_map(|end| {
        let bucket = &mut placed[start..*end];
        start = *end;
        bucket.sort_unstable();
        bucket.windows(2).find(|two| two[0] == two[1]).map(|two| two[0])
    })
}
