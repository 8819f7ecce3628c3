//! The work of a consumer on a pair, equal in every timed frame of every contender: the least that
//! needs both indices.

use crate::oracle::Pair;

/// Visited pairs: their number, and a sum that depends on each pair but not on the order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Pairs.
    pub count: u64,
    /// Sum of a ^ b, less than 1 ns a pair. Different sets may have the same sum; a comparison of
    /// sets, pair by pair, is done apart.
    pub sum: u64,
}

impl Tally {
    /// The tally of these pairs.
    pub fn of(pairs: &[Pair]) -> Self {
        let mut tally = Self::default();
        for &(a, b) in pairs {
            tally.visit(a, b);
        }
        tally
    }

    /// Visits a pair.
    #[inline(always)]
    pub fn visit(&mut self, a: u32, b: u32) {
        self.count += 1;
        self.sum += u64::from(a ^ b);
    }

    /// The tally of two parts of the pairs together.
    #[must_use]
    pub const fn plus(self, other: Self) -> Self {
        Self { count: self.count + other.count, sum: self.sum + other.sum }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tally_depends_on_all_but_the_order() {
        let of = Tally::of;
        assert_eq!(of(&[(0, 1), (2, 7)]), of(&[(7, 2), (1, 0)]));
        assert_eq!(of(&[(0, 1)]).plus(of(&[(2, 7)])), of(&[(0, 1), (2, 7)]));
        assert_ne!(of(&[(0, 1), (2, 7)]), of(&[(0, 1)]));
        assert_ne!(of(&[(0, 1), (2, 7)]), of(&[(0, 1), (2, 6)]));
    }
}
