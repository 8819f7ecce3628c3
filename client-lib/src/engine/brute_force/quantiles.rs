//! Bucket borders of an axis: quantiles of a sample of its keys.

use super::bitmaps::BUCKETS;
use crate::aabb::KeyBox;
use crate::engine::ingest::WORD_COLUMNS;

/// Keys sampled on an axis: two for every bucket. More would even the buckets out and take longer
/// to sort than they save.
const SAMPLES: usize = 2 * BUCKETS;

/// Ascending keys; the bucket of a key is the number of borders that are not above it.
pub(super) struct Borders([i32; BUCKETS]);

impl Borders {
    /// Borders from a sample, evenly spaced in index: mins and maxes in turn.
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
        let sample = &mut sample[..solid];
        sample.sort_unstable();
        // The last border is above every key: there are one fewer borders than buckets.
        let mut borders = [i32::MAX; BUCKETS];
        for (i, border) in borders[..BUCKETS - 1].iter_mut().enumerate() {
            if let Some(key) = sample.get((i + 1) * solid / BUCKETS) {
                *border = *key;
            }
        }
        Self(borders)
    }

    /// All borders, ascending. The last one is `i32::MAX`.
    pub fn keys(&self) -> &[i32; BUCKETS] {
        &self.0
    }

    /// The bucket of a key of a number.
    #[inline(always)]
    pub fn bucket(&self, key: i32) -> u8 {
        let mut below = 0;
        let mut step = BUCKETS / 2;
        while step > 0 {
            // Both ways take the same time: no branch to mispredict.
            below += step * usize::from(self.0[below + step - 1] <= key);
            step /= 2;
        }
        below as u8
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
        assert!(borders.keys().is_sorted());
        let probes = keys.iter().flat_map(|&k| [k - 1, k, k + 1]);
        for key in probes.chain([i32::MIN, -1, 0, 1, i32::MAX - 1]) {
            let counted = borders.keys().iter().filter(|b| **b <= key).count();
            assert_eq!(usize::from(borders.bucket(key)), counted, "{key}");
        }
        for bucket in 0..BUCKETS {
            let held = keys.iter().filter(|k| usize::from(borders.bucket(**k)) == bucket).count();
            assert!((1..100).contains(&held), "bucket {bucket} holds {held} of 1000");
        }
    }

    #[test]
    fn a_sample_of_boxes_that_overlap_nothing_has_one_bucket() {
        let borders = borders(&[i32::MAX; 300]);
        assert_eq!((borders.bucket(i32::MIN), borders.bucket(i32::MAX - 1)), (0, 0));
    }
}
