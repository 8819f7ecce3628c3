//! What a consumer does with a pair, in every timed frame of every contender: the least that still
//! needs both indices.

use crate::oracle::Pair;

/// Pairs visited: how many, and a sum that depends on each but on no order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Pairs.
    pub count: u64,
    /// Sum of a ^ b. It misses what sets compared pair by pair show; it costs less than 1 ns.
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

    /// With another part of the pairs.
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
