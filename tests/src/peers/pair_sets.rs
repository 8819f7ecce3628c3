//! Whether two contenders found the same pairs, and where they first differ.

use crate::oracle::Pair;

/// How two sets of pairs differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Difference {
    /// A pair is missing.
    #[error("the pair ({}, {}) is missing", .0.0, .0.1)]
    Missing(Pair),
    /// A pair of the list is no pair of the scene.
    #[error("the pair ({}, {}) is no pair of the scene", .0.0, .0.1)]
    Extra(Pair),
    /// A pair is there more than once.
    #[error("the pair ({}, {}) is there more than once", .0.0, .0.1)]
    Twice(Pair),
}

/// A set of pairs, each with its lower index first, sorted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PairSet(Vec<Pair>);

impl PairSet {
    /// The set of these pairs, in any order.
    ///
    /// # Errors
    /// [`Difference::Twice`] names a pair that is listed again.
    pub fn new(mut pairs: Vec<Pair>) -> Result<Self, Difference> {
        for pair in &mut pairs {
            *pair = (pair.0.min(pair.1), pair.0.max(pair.1));
        }
        pairs.sort_unstable();
        match pairs.windows(2).find(|two| two[0] == two[1]) {
            Some(two) => Err(Difference::Twice(two[0])),
            None => Ok(Self(pairs)),
        }
    }

    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no pair.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether `found` lists exactly the pairs of this set.
    ///
    /// # Errors
    /// The first [`Difference`].
    pub fn check(&self, found: Vec<Pair>) -> Result<(), Difference> {
        let found = Self::new(found)?;
        let first = self.0.iter().zip(&found.0).find(|(truth, found)| truth != found);
        let shorter = self.len().min(found.len());
        match first {
            Some((&truth, &found)) if truth < found => Err(Difference::Missing(truth)),
            Some((_, &found)) => Err(Difference::Extra(found)),
            None if self.len() > shorter => Err(Difference::Missing(self.0[shorter])),
            None if found.len() > shorter => Err(Difference::Extra(found.0[shorter])),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> PairSet {
        PairSet::new(vec![(0, 1), (5, 2), (3, 4)]).expect("three pairs")
    }

    #[test]
    fn equal_sets_are_equal_in_any_order() {
        assert_eq!(truth().check(vec![(4, 3), (2, 5), (0, 1)]), Ok(()));
        assert_eq!(PairSet::default().check(vec![]), Ok(()));
    }

    #[test]
    fn every_difference_is_found_and_named() {
        let check = |pairs: &[Pair]| truth().check(pairs.to_vec());
        assert_eq!(check(&[]), Err(Difference::Missing((0, 1))));
        assert_eq!(check(&[(0, 1), (2, 5)]), Err(Difference::Missing((3, 4))));
        assert_eq!(check(&[(0, 1), (3, 4)]), Err(Difference::Missing((2, 5))));
        assert_eq!(check(&[(0, 1), (2, 5), (3, 4), (6, 7)]), Err(Difference::Extra((6, 7))));
        assert_eq!(check(&[(0, 1), (0, 2), (2, 5), (3, 4)]), Err(Difference::Extra((0, 2))));
        // The same number of pairs, with one bit of an index changed.
        assert_eq!(check(&[(0, 1), (2, 5), (3, 5)]), Err(Difference::Missing((3, 4))));
        assert_eq!(check(&[(0, 1), (2, 4), (3, 4)]), Err(Difference::Extra((2, 4))));
        // The same number of pairs, one of them twice.
        assert_eq!(check(&[(0, 1), (2, 5), (5, 2)]), Err(Difference::Twice((2, 5))));
        assert_eq!(PairSet::default().check(vec![(1, 2)]), Err(Difference::Extra((1, 2))));
    }
}
