//! Rules as arrays that are looked up by a box's index, for engines that test pairs as they find them: the
//! GPU's grid.

use super::groups::Groups;
use super::kinds::Kinds;
use super::look::Look;
use crate::filters::{Rules, World};
use crate::team;

/// Kinds that are distinguished, at most: a filter, and whether the box is static. Their table takes 8 KiB.
pub const MARKED_KINDS: usize = 256;
/// Bit of a mark from which on it has the rank of the box's world; the bits below are its kind, and whether
/// a list of pairs names it.
pub const RANK_SHIFT: u32 = 9;

const LISTED: u32 = MARKED_KINDS as u32;
const KIND_WORDS: usize = MARKED_KINDS / 32;
/// Ranks that a mark has room for.
const MOST_WORLDS: usize = 1 << (32 - RANK_SHIFT);

const _: () = assert!(MARKED_KINDS == 1 << (RANK_SHIFT - 1), "a kind, and one bit");

/// What rules say of each box of a frame.
///
/// Two boxes may meet if both are of one world, if their owners differ or are 0, and if their kinds meet; of
/// two that lists name, the rules themselves have to be asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Marks {
    words: Vec<u32>,
    worlds: Vec<World>,
    largest_world: usize,
    has_lists: bool,
}

impl Marks {
    /// The marks of the first `n` boxes. `None` where the boxes are of too many kinds, or are of several
    /// worlds and of all of them, or are of several worlds and there are lists.
    pub fn of(rules: &Rules, n: usize, threads: usize) -> Option<Self> {
        let _team = team::enter(threads);
        let look = Look::at(rules, n);
        let mut kind_of = Vec::new();
        let filter_data = |index| rules.filter_data(index);
        let kinds = Kinds::of(rules, n, filter_data, MARKED_KINDS, &mut kind_of, threads)?;
        let mut words = kinds.meets(rules, KIND_WORDS);
        words.resize(MARKED_KINDS * KIND_WORDS, 0);
        let first_box = words.len();
        words.reserve(2 * n);
        for (index, kind) in (0..).zip(&kind_of) {
            words.extend([filter_data(index).owner.0, u32::from(*kind)]);
        }
        let mark_at = |index: u32| first_box + 2 * index as usize + 1;
        let has_lists = !rules.lists.is_empty();
        for index in rules.lists.included().chain(rules.lists.excluded()).flatten() {
            if let Some(mark) = words.get_mut(mark_at(index)) {
                *mark |= LISTED;
            }
        }
        let (mut worlds, mut largest_world) = (Vec::new(), n);
        if let Some(span) = look.worlds {
            let mut groups = Groups::default();
            groups.sort(rules, None, n, span);
            let count = groups.groups().len();
            if has_lists || count > MOST_WORLDS || !groups.of_all().is_empty() {
                return None;
            }
            for (rank, group) in (0..).zip(groups.groups()) {
                for index in groups.members(group) {
                    words[mark_at(*index)] |= rank << RANK_SHIFT;
                }
            }
            worlds = groups.groups().iter().map(|group| group.world).collect();
            largest_world = groups.groups().iter().map(|g| g.members.len()).max().unwrap_or(0);
        }
        Some(Self { words, worlds, largest_world, has_lists })
    }

    /// For each kind, [`MARKED_KINDS`] bits, of those that it meets; then for each box its owner and its
    /// mark.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// The worlds, by rank, rising; none where all boxes are of one.
    pub fn worlds(&self) -> &[World] {
        &self.worlds
    }

    /// Boxes of the largest world.
    pub const fn largest_world(&self) -> usize {
        self.largest_world
    }

    /// Whether the rules have to be asked of pairs of listed boxes.
    pub const fn has_lists(&self) -> bool {
        self.has_lists
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{KINDS, Random, rules};
    use super::*;
    use crate::filters::Owner;

    /// What marks say of two boxes, as `box_rules.wgsl` reads them; `None` where the rules decide.
    fn meet(marks: &Marks, a: u32, b: u32) -> Option<bool> {
        let first = MARKED_KINDS * KIND_WORDS;
        let of = |index: u32| {
            let at = first + 2 * index as usize;
            (marks.words[at], marks.words[at + 1])
        };
        let ((owner_a, a), (owner_b, b)) = (of(a), of(b));
        if a >> RANK_SHIFT != b >> RANK_SHIFT {
            return Some(false);
        }
        if a & b & LISTED != 0 {
            return None;
        }
        if owner_a != 0 && owner_a == owner_b {
            return Some(false);
        }
        let (kind_a, kind_b) = (a as usize % MARKED_KINDS, b as usize % MARKED_KINDS);
        Some(marks.words[kind_a * KIND_WORDS + kind_b / 32] >> (kind_b % 32) & 1 == 1)
    }

    #[test]
    fn marks_say_what_rules_say() {
        let mut random = Random(91);
        let (mut decided, mut marked) = (0, 0);
        for n in [1, 2, 33, 70] {
            for kind in KINDS {
                for _ in 0..8 {
                    let rules = rules(&mut random, n, kind);
                    let Some(marks) = Marks::of(&rules, n, 1) else { continue };
                    marked += 1;
                    let pairs = (0..n as u32).flat_map(|a| (a + 1..n as u32).map(move |b| (a, b)));
                    for (a, b) in pairs {
                        if let Some(met) = meet(&marks, a, b) {
                            assert_eq!(met, rules.meet(a, b), "{kind:?}: {a} and {b} of {n}");
                            decided += 1;
                        }
                    }
                }
            }
        }
        assert!(marked > 20 && decided > 10_000, "{marked} rules, {decided} pairs");
    }

    #[test]
    fn worlds_have_ranks_and_boxes_of_all_worlds_have_no_marks() {
        let mut rules = Rules::default();
        let of = |world| crate::filters::FilterData::default().with_world(World(world));
        rules.filter_data = vec![of(7), of(-3), of(7).with_owner(Owner(5))];
        let marks = Marks::of(&rules, 3, 1).expect("marks");
        assert_eq!(marks.worlds(), [World(-3), World(7)]);
        assert_eq!(marks.largest_world(), 2);
        assert_eq!(meet(&marks, 0, 2), Some(true));
        assert_eq!(meet(&marks, 0, 1), Some(false));
        assert!(!marks.has_lists());
        rules.filter_data.push(of(-1));
        assert_eq!(Marks::of(&rules, 4, 1), None);
        rules.filter_data.pop();
        rules.lists.exclude([0, 2], true);
        assert_eq!(Marks::of(&rules, 3, 1), None, "lists and worlds");
        rules.filter_data.clear();
        let marks = Marks::of(&rules, 3, 1).expect("lists alone");
        assert_eq!((meet(&marks, 0, 2), meet(&marks, 0, 1)), (None, Some(true)));
        assert!(marks.has_lists() && marks.worlds().is_empty());
    }
}
