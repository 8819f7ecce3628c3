//! Bucket borders of an axis: quantiles of a sample of its keys.

use super::bitmaps::BUCKETS;
use crate::aabb::KeyBox;
use crate::engine::ingest::WORD_COLUMNS;

/// Keys sampled on an axis: two for every bucket. More would even the buckets out and take longer
/// to sort than they save.
const SAMPLES: usize = 2 * BUCKETS;

/// Border keys of an axis. The bucket of a key is the number of borders that are not above it.
///
/// The borders form a search tree laid out level by level: level l starts at 2^l − 1, and the
/// children of its node k are nodes 2k and 2k + 1 of the next. A level fits into one or two SIMD
/// registers, so that a step of the search is a shuffle.
pub(super) struct Borders([i32; BUCKETS]);

/// Levels of the search tree.
pub(super) const LEVELS: usize = BUCKETS.ilog2() as usize;
const _: () = assert!(1 << LEVELS == BUCKETS, "a full tree has 2^l - 1 nodes");

impl Borders {
    /// Borders from a sample, evenly spaced in index: mins and maxes in turn.
    #[inline(always)]
    pub fn of_sample(
        mins: &[[i32; WORD_COLUMNS]],
        maxes: &[[i32; WORD_COLUMNS]],
        n: usize,
    ) -> Self {
        let (mins, maxes) = (mins.as_flattened(), maxes.as_flattened());
        let mut sample = [KeyBox::NOTHING.min[0]; SAMPLES];
        let mut solid = 0;
        for s in 0..SAMPLES {
            let index = s * n / SAMPLES;
            if mins[index] != KeyBox::NOTHING.min[0] {
                sample[solid] = if s % 2 == 0 { mins[index] } else { maxes[index] };
                solid += 1;
            }
        }
        sort(&mut sample);
        let border = |i: usize| sample[(i + 1) * solid / BUCKETS];
        let mut tree = [i32::MAX; BUCKETS];
        for level in 0..LEVELS {
            for node in 0..1 << level {
                tree[(1 << level) - 1 + node] =
                    border(((2 * node + 1) << (LEVELS - 1 - level)) - 1);
            }
        }
        Self(tree)
    }

    /// The search tree, level by level. The last entry is no node.
    #[cfg(any(target_arch = "x86_64", test))]
    pub fn tree(&self) -> &[i32; BUCKETS] {
        &self.0
    }

    /// The bucket of a key; [`BUCKETS`] itself for the min keys of boxes that overlap nothing.
    #[inline(always)]
    pub fn bucket(&self, key: i32) -> u8 {
        let mut node = 0;
        for level in 0..LEVELS {
            // Both ways take the same time: no branch to mispredict.
            node = 2 * node + usize::from(self.0[(1 << level) - 1 + node] <= key);
        }
        node as u8 + u8::from(key == KeyBox::NOTHING.min[0])
    }
}

/// Sorts by counting, for each key, the smaller ones: quadratic, and as SIMD without a branch
/// faster than a sort for so few.
#[inline(always)]
fn sort(keys: &mut [i32; SAMPLES]) {
    let unsorted = *keys;
    let mut ranks = [0u32; SAMPLES];
    for key in unsorted {
        for (rank, &other) in ranks.iter_mut().zip(&unsorted) {
            *rank += u32::from(key < other);
        }
    }
    // Equal keys share a rank and leave gaps behind it, which the largest key so far fills.
    *keys = [i32::MIN; SAMPLES];
    for (rank, key) in ranks.iter().zip(&unsorted) {
        keys[*rank as usize % SAMPLES] = *key;
    }
    let mut largest = i32::MIN;
    for key in keys {
        largest = largest.max(*key);
        *key = largest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn borders(keys: &[i32]) -> Borders {
        let mut columns = vec![[i32::MAX; WORD_COLUMNS]; keys.len().div_ceil(WORD_COLUMNS)];
        columns.as_flattened_mut()[..keys.len()].copy_from_slice(keys);
        Borders::of_sample(&columns, &columns, keys.len())
    }

    #[test]
    fn buckets_count_the_borders_that_are_not_above() {
        let keys: Vec<i32> = (0..1000).map(|i| (i * 7919 % 1000 - 500) * 1000).collect();
        let borders = borders(&keys);
        let nodes = &borders.tree()[..BUCKETS - 1];
        let probes = keys.iter().flat_map(|&k| [k - 1, k, k + 1]);
        for key in probes.chain([i32::MIN, -1, 0, 1, i32::MAX - 1]) {
            let counted = nodes.iter().filter(|b| **b <= key).count();
            assert_eq!(usize::from(borders.bucket(key)), counted, "{key}");
        }
        assert_eq!(usize::from(borders.bucket(KeyBox::NOTHING.min[0])), BUCKETS);
        for bucket in 0..BUCKETS {
            let held = keys.iter().filter(|k| usize::from(borders.bucket(**k)) == bucket).count();
            assert!((1..100).contains(&held), "bucket {bucket} holds {held} of 1000");
        }
    }

    #[test]
    fn samples_sort_with_their_doubles() {
        let mut keys: [i32; SAMPLES] = std::array::from_fn(|i| (i as i32 * 37 % 41) - 20);
        let mut expected = keys;
        expected.sort_unstable();
        sort(&mut keys);
        assert_eq!(keys, expected);
    }

    #[test]
    fn a_sample_of_boxes_that_overlap_nothing_has_one_bucket() {
        let borders = borders(&[i32::MAX; 300]);
        assert_eq!((borders.bucket(i32::MIN), borders.bucket(i32::MAX - 1)), (0, 0));
    }
}
