//! A few boxes of a frame, and what else decides its answer.

use super::kept::MOST_BYTES;
use crate::dispatch::CullOptions;
use crate::objects::{ObjectForm, Objects};

/// Boxes of a frame that looks different from the one before: reading them takes less than 0.1 µs.
const FEW: usize = 4;
/// Boxes of a frame that looks like the one before. One moving box in fifty is seen by most samples of
/// this size, before anything is copied.
const MANY: usize = 66;
/// A sample has at most one box in so many, beyond the first few: comparing all is no longer cheap beside
/// a cull of 64 boxes (2 µs).
const A_SAMPLED_BOX: usize = 16;
/// Bytes of the largest object.
const SLOT_BYTES: usize = 24;

/// What decides the answer to a frame, beside its objects' numbers. Threads do not: the pairs are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Facts {
    form: ObjectForm,
    n: usize,
    options: CullOptions,
    limit_words: u64,
    /// The number of the frame's rules; 0 where all boxes may meet.
    rules: u64,
}

impl Facts {
    pub(super) fn of(
        objects: Objects<'_>,
        options: &CullOptions,
        rules: u64,
        limit_words: u64,
    ) -> Self {
        let options = CullOptions { last_pairs: None, threads: None, ..*options };
        Self { form: objects.form(), n: objects.len(), options, limit_words, rules }
    }

    /// Whether these are so many objects of this form.
    pub(super) fn is_of(&self, objects: Objects<'_>) -> bool {
        (self.form, self.n) == (objects.form(), objects.len())
    }

    /// Whether the objects alone leave room for a copy.
    pub(super) fn may_be_kept(&self) -> bool {
        self.n.saturating_mul(self.form.object_bytes()) <= MOST_BYTES
    }
}

/// What is remembered of each frame.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    facts: Option<Facts>,
    /// The objects at the first places, bit by bit.
    slots: [[u8; SLOT_BYTES]; MANY],
    taken: usize,
}

impl Default for Sample {
    fn default() -> Self {
        Self { facts: None, slots: [[0; SLOT_BYTES]; MANY], taken: 0 }
    }
}

impl Sample {
    /// Of which frame it is.
    pub(super) const fn facts(&self) -> Option<Facts> {
        self.facts
    }

    /// Whether a frame may be equal to the one that was sampled.
    pub(super) fn is_alike(&self, facts: &Facts, objects: Objects<'_>) -> bool {
        if self.facts.as_ref() != Some(facts) {
            return false;
        }
        let object_bytes = facts.form.object_bytes();
        let bytes = objects.as_bytes();
        (0..self.taken)
            .all(|k| object_at(bytes, facts.n, object_bytes, k) == &self.slots[k][..object_bytes])
    }

    /// Takes the first boxes of a frame's sample.
    pub(super) fn take(&mut self, facts: &Facts, objects: Objects<'_>) {
        (self.facts, self.taken) = (Some(*facts), 0);
        self.take_up_to(FEW, objects);
    }

    /// Takes the rest of the sample of a frame that looks like the one that was sampled.
    pub(super) fn extend(&mut self, objects: Objects<'_>) {
        self.take_up_to(MANY.min(FEW.max(objects.len() / A_SAMPLED_BOX)), objects);
    }

    /// Remembers nothing.
    pub(super) const fn clear(&mut self) {
        self.facts = None;
    }

    fn take_up_to(&mut self, count: usize, objects: Objects<'_>) {
        let (n, object_bytes) = (objects.len(), objects.form().object_bytes());
        let bytes = objects.as_bytes();
        for k in self.taken..count {
            self.slots[k][..object_bytes].copy_from_slice(object_at(bytes, n, object_bytes, k));
        }
        self.taken = self.taken.max(count);
    }
}

/// The object at place `k` of the sample of `n` objects: the first, the last, then others, such that those
/// at the first few places are spread evenly, however many they are.
fn object_at(bytes: &[u8], n: usize, object_bytes: usize, k: usize) -> &[u8] {
    let index = if k == 1 {
        n - 1
    } else {
        // The fractional parts of multiples of the golden ratio are spread evenly.
        let fraction = u128::from((k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        ((fraction * n as u128) >> 64) as usize
    };
    &bytes[index * object_bytes..][..object_bytes]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_has_the_first_and_the_last_and_others_all_over() {
        for n in [1usize, 2, 3, 65, 1_000, 1_000_003] {
            let bytes: Vec<u8> = (0..n).flat_map(|i| (i as u32).to_ne_bytes()).collect();
            let index = |k| {
                let object = object_at(&bytes, n, 4, k);
                u32::from_ne_bytes(object.try_into().expect("4 bytes")) as usize
            };
            assert_eq!((index(0), index(1)), (0, n - 1));
            for count in [FEW, MANY] {
                let mut found: Vec<usize> = (0..count).map(index).collect();
                found.sort_unstable();
                let gaps = found.windows(2).map(|two| two[1] - two[0]);
                assert!(gaps.max() <= Some(2 * n / count + n / 3 + 1), "{n} {count}: {found:?}");
            }
        }
    }
}
