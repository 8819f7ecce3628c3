//! What is soonest done after an edit: to look around the changed boxes in cells, or in a tree, or to cull the whole scene.
//!
//! All by counts, not by clocks. Measured on one and two threads, from 20,000 to a million boxes: evenly spread, dense,
//! flat, of sizes over three decades, with long ones among them, rods, and woven straps; on 16 threads evenly spread ones.

use crate::aabb::{Aabb, is_valid};
use crate::floats;

/// What a box that changed takes beside the tests of its search, in tests of boxes in cells: where it is about where it was,
/// and more where it has gone farther, and is looked around at two places.
const NEAR_TESTS: u64 = 210;
const FAR_TESTS: u64 = 280;
/// Further threads shorten a whole cull by more than searches in cells, which take so much longer beside it for each.
const THREAD_PERCENT: u64 = 4;
/// Tests of a search among boxes that cells part.
const USUAL_TESTS: u64 = 28;
/// What a box of a whole scene takes that is culled, in such tests, and a pair of it; and a share of the comparisons of the
/// last such cull, of which there are so many a box where none was made yet.
const WHOLE_TESTS: u64 = 18;
const PAIR_TESTS: u64 = 4;
const COMPARED_PERCENT: u64 = 70;
const UNKNOWN_TESTS: u64 = 32;
/// Boxes that may always be looked around.
const FEW_BOXES: u64 = 64;
/// Changed boxes that are looked around at the most: one in so many.
const MOST_SHARE: u64 = 3;
/// Boxes and groups of a tree that are looked at in the time that a whole cull takes for a box, beside its comparisons.
const LOOKS_A_BOX: u64 = 12;
/// What is known counts as much as so many searches: those of an edit of few boxes change little.
const KNOWN_SEARCHES: u64 = 1_024;
/// Of what is known of searches so much is forgotten each time that there are none, one in so many, so that they are tried
/// again: cells are built in the time of one to four culls.
const FORGOTTEN_SHARE: u64 = 64;
/// A box is about where it was if it has not moved by more of an edge than this: beyond, most are kept at two places in cells.
const NEAR_SHARE: f32 = 0.1;

/// A scene, of which some boxes have changed since its history began.
#[derive(Clone, Copy, Debug)]
pub(super) struct Account {
    pub boxes: u64,
    /// Pairs that were reported.
    pub pairs: u64,
    /// Pairs that the last cull of all compared, if there was one.
    pub compared: Option<u64>,
    /// Of some changed boxes, those that have gone far.
    pub far: u64,
    pub of: u64,
    /// Threads for a cull of all.
    pub threads: usize,
}

/// What searches took.
#[derive(Clone, Copy, Debug)]
pub(super) struct Worth {
    /// Tests of one in cells.
    tests: u64,
    /// Boxes and groups that one in a tree looked at.
    looks: u64,
}

impl Account {
    const fn compared(&self) -> u64 {
        match self.compared {
            Some(compared) => compared,
            None => UNKNOWN_TESTS * self.boxes,
        }
    }

    /// Boxes and groups of a tree that are looked at in the time in which the whole scene is culled, and listed.
    pub const fn most_looks(&self) -> u64 {
        LOOKS_A_BOX * self.boxes + self.compared()
    }
}

impl Worth {
    /// Nothing was searched yet.
    pub const UNKNOWN: Self = Self { tests: USUAL_TESTS, looks: 0 };

    /// As many changed boxes take as long to be looked around in cells as the whole scene does. Where these do not part the
    /// boxes, a cull of all takes long too, and a tree [pays](Self::does_tree_pay) or not.
    pub fn many(&self, account: Account, is_crowded: bool) -> usize {
        let Account { boxes, pairs, far, of, threads, .. } = account;
        let (far, of, tests) = match of {
            _ if is_crowded => (0, 1, USUAL_TESTS),
            0 => (0, 1, self.tests),
            _ => (far, of, self.tests),
        };
        let whole = (WHOLE_TESTS * boxes)
            .saturating_add(PAIR_TESTS.saturating_mul(pairs))
            .saturating_add(account.compared().saturating_mul(COMPARED_PERCENT) / 100);
        let slower = 100 + THREAD_PERCENT * threads.saturating_sub(1) as u64;
        let of_judged = ((NEAR_TESTS + tests) * of + FAR_TESTS * far) * slower / 100;
        let many = whole.saturating_mul(of) / of_judged;
        many.min(boxes / MOST_SHARE).max(FEW_BOXES) as usize
    }

    /// Whether so many boxes are sooner looked around in a tree than all are culled.
    pub const fn does_tree_pay(&self, count: usize, account: Account) -> bool {
        (count as u64).saturating_mul(self.looks) <= account.most_looks()
    }

    /// Notes the tests of so many searches in cells.
    pub const fn note_tests(&mut self, searches: usize, tests: u64) {
        self.tests = average(self.tests, searches, tests);
    }

    /// Notes what so many searches in a tree looked at.
    pub const fn note_looks(&mut self, searches: usize, looks: u64) {
        self.looks = average(self.looks, searches, looks);
    }

    /// Notes that nothing was searched for in cells.
    pub const fn forget_tests(&mut self) {
        self.tests -= self.tests.div_ceil(FORGOTTEN_SHARE);
    }

    /// Notes that nothing was searched for in a tree.
    pub const fn forget_looks(&mut self) {
        self.looks -= self.looks.div_ceil(FORGOTTEN_SHARE);
    }
}

/// What is known of a search, with what so many took together.
const fn average(known: u64, searches: usize, took: u64) -> u64 {
    let all = KNOWN_SEARCHES.saturating_mul(known).saturating_add(took);
    all / KNOWN_SEARCHES.saturating_add(searches as u64)
}

/// Whether a box is about where it was, or is looked around at one place since it was, or is, nowhere.
pub(super) fn is_near(was: &Aabb, is: &Aabb) -> bool {
    floats::with_default(|| {
        let is_near = |axis: usize| {
            let moved = (is.min[axis] - was.min[axis]).abs();
            moved <= NEAR_SHARE * (was.max[axis] - was.min[axis])
        };
        !is_valid(was) || !is_valid(is) || (0..3).all(is_near)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100,000 boxes with so many pairs, of which a cull compares so many.
    const fn scene(pairs: u64, compared: u64) -> Account {
        Account { boxes: 100_000, pairs, compared: Some(compared), far: 0, of: 64, threads: 1 }
    }

    #[test]
    fn fewer_boxes_are_looked_around_that_take_longer() {
        let uniform = scene(100_000, 3_200_000);
        let near = Worth::UNKNOWN.many(uniform, false);
        assert!((15_000..20_000).contains(&near), "{near}");
        let far = Worth::UNKNOWN.many(Account { far: 64, ..uniform }, false);
        assert!((7_000..10_000).contains(&far), "{far}");
        let mut among_straps = Worth::UNKNOWN;
        among_straps.note_tests(100_000, 39_000_000);
        let straps = among_straps.many(scene(124_000, 3_800_000), false);
        assert!((6_000..10_000).contains(&straps), "{straps}");
        let dense = Worth::UNKNOWN.many(scene(1_140_000, 9_000_000), false);
        assert_eq!(dense as u64, 100_000 / MOST_SHARE);
        let none = Account { boxes: 0, pairs: 0, compared: None, far: 0, of: 0, threads: 16 };
        assert_eq!(Worth::UNKNOWN.many(none, false) as u64, FEW_BOXES);
        let on_16_threads = Worth::UNKNOWN.many(Account { threads: 16, ..uniform }, false);
        assert!((9_000..13_000).contains(&on_16_threads), "{on_16_threads}");
        let most = Account { boxes: u64::from(u32::MAX), pairs: u64::from(u32::MAX), ..none };
        assert!(Worth::UNKNOWN.many(Account { compared: Some(u64::MAX / 2), ..most }, true) > 0);
    }

    #[test]
    fn a_tree_is_tried_again_after_a_while() {
        let rods = scene(53_000, 23_000_000);
        let mut worth = Worth::UNKNOWN;
        assert!(worth.does_tree_pay(50_000, rods), "it is not known");
        worth.note_looks(1, rods.most_looks());
        assert!(worth.does_tree_pay(1_000, rods), "one of an edit of one box");
        worth.note_looks(1_000, 4 * rods.most_looks());
        assert!(!worth.does_tree_pay(1_000, rods) && worth.does_tree_pay(400, rods));
        let turns = (0..).take_while(|_| {
            worth.forget_looks();
            !worth.does_tree_pay(1_000, rods)
        });
        assert!((30..60).contains(&turns.count()));
    }

    #[test]
    fn near_is_a_tenth_of_an_edge() {
        let was = Aabb::new([0.0; 3], [1.0, 2.0, 4.0]);
        for (by, near) in
            [([0.1, 0.2, 0.4], true), ([0.11, 0.0, 0.0], false), ([0.0, 0.3, 0.0], false)]
        {
            assert_eq!(is_near(&was, &was.moved(by).0), near, "{by:?}");
        }
        assert!(is_near(&Aabb::EMPTY, &was) && is_near(&was, &Aabb::point([f32::NAN; 3])));
    }
}
