//! How often the integer part of an approximated root is wrong (Avril et al. 2012, table 3).

use crate::study::mapping::stage::Root;
use rayon::prelude::*;
use serde::Serialize;

use super::roots::{RootVisitor, with_root};

/// Wrong integer parts among the roots of 1 to `count`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RootTally {
    /// Numbers that were checked.
    pub count: u64,
    /// Integer parts other than the built-in root's, which is what the paper counts.
    pub other: u64,
    /// Integer parts other than the exact one of the integer.
    pub inexact: u64,
}

/// Numbers of one parallel task: large enough that starting it costs nothing.
const CHUNK: u64 = 1 << 16;

struct Count(u64);

impl RootVisitor for Count {
    type Out = RootTally;

    fn visit(self, root: impl Fn(f32) -> f32 + Copy + Sync) -> RootTally {
        let count = self.0;
        let (other, inexact) = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let (mut other, mut inexact) = (0, 0);
                for x in chunk * CHUNK + 1..=count.min((chunk + 1) * CHUNK) {
                    let part = root(x as f32) as u64;
                    other += u64::from(part != (x as f32).sqrt() as u64);
                    inexact += u64::from(part * part > x || (part + 1) * (part + 1) <= x);
                }
                (other, inexact)
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        RootTally { count, other, inexact }
    }
}

/// Counts the wrong integer parts of the roots of 1 to `count`.
pub fn count(root: Root, count: u64) -> RootTally {
    with_root(root, Count(count))
}

#[cfg(test)]
mod tests {
    use crate::study::mapping::stage::{Magic, Steps};

    use super::*;

    /// Known figures, so that a change of arithmetic is noticed.
    #[test]
    fn shares_are_near_those_of_the_paper() {
        for (magic, steps, numbers, other) in [
            (Magic::Carmack, Steps::Two, 1000, 30),
            (Magic::Lomont, Steps::Two, 1000, 29),
            (Magic::Carmack, Steps::Two, 100_000, 279),
            (Magic::Carmack, Steps::Two, 1_000_000, 1813),
            (Magic::Lomont, Steps::Two, 1_000_000, 1819),
            (Magic::Carmack, Steps::Three, 100_000, 70),
            (Magic::Carmack, Steps::Four, 100_000, 84),
        ] {
            let tally = count(Root::Newton(magic, steps), numbers);
            assert_eq!((tally.other, tally.inexact), (other, other), "{magic:?} {steps:?}");
        }
    }

    #[test]
    fn the_built_in_root_is_exact_up_to_a_million_and_a_bad_root_is_noticed() {
        assert_eq!(count(Root::BuiltIn, 1_000_000).inexact, 0);
        assert_eq!(Count(100).visit(|x| x.sqrt() + 1.0).inexact, 100);
    }
}
