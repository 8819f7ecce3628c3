//! Boxes by world.

use std::num::NonZeroU64;
use std::ops::Range;

use crate::filters::{Rules, World};

/// Worlds between the least and the greatest, for each box, up to which boxes are sorted by counting.
const COUNTED_SPAN: usize = 4;

/// A world and its boxes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    pub world: World,
    /// Its place in [`Groups::members`].
    pub members: Range<usize>,
}

/// Boxes by world: each of one world once, by rising index.
#[derive(Debug, Default)]
pub struct Groups {
    members: Vec<u32>,
    worlds: Vec<Group>,
    starts: Vec<u32>,
    /// Rules and boxes that they are of, where the rules have a number.
    sorted: Option<(NonZeroU64, usize)>,
}

impl Groups {
    /// Sorts the first `n` boxes. All their worlds but [`World::ALL`] are in `span`. Rules of the number of
    /// those before are those.
    pub fn sort(&mut self, rules: &Rules, known: Option<NonZeroU64>, n: usize, span: [i32; 2]) {
        let sorted = known.map(|number| (number, n));
        if sorted.is_some() && sorted == self.sorted {
            return;
        }
        self.sorted = None;
        let width = (i64::from(span[1]) - i64::from(span[0]) + 1).unsigned_abs() as usize;
        // World::ALL has the place after the last.
        let slot = |index: u32| match rules.filter_data(index).world {
            World::ALL => width,
            World(world) => (i64::from(world) - i64::from(span[0])) as usize,
        };
        self.worlds.clear();
        self.members.clear();
        if (0..n as u32).is_sorted_by_key(slot) {
            self.members.extend(0..n as u32);
        } else if width <= COUNTED_SPAN * n {
            self.members.resize(n, 0);
            self.sort_by_counting(n, width, slot);
        } else {
            self.members.extend(0..n as u32);
            self.members.sort_by_key(|index| slot(*index));
        }
        let mut start = 0;
        let members = &self.members;
        for alike in members.chunk_by(|a, b| slot(*a) == slot(*b)) {
            let (first, end) = (alike[0], start + alike.len());
            self.worlds.push(Group { world: rules.filter_data(first).world, members: start..end });
            start = end;
        }
        self.worlds.sort_by_key(|group| group.world);
        self.sorted = sorted;
    }

    fn sort_by_counting(&mut self, n: usize, width: usize, slot: impl Fn(u32) -> usize) {
        self.starts.clear();
        self.starts.resize(width + 2, 0);
        for index in 0..n as u32 {
            self.starts[slot(index) + 1] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        for index in 0..n as u32 {
            let next = &mut self.starts[slot(index)];
            self.members[*next as usize] = index;
            *next += 1;
        }
    }

    /// The worlds that have boxes, rising.
    pub fn groups(&self) -> &[Group] {
        &self.worlds
    }

    /// The boxes of a world, by rising index.
    pub fn members(&self, group: &Group) -> &[u32] {
        &self.members[group.members.clone()]
    }

    /// The boxes of a world, and those of all worlds that meet them.
    pub fn boxes_of(&self, group: &Group) -> (&[u32], &[u32]) {
        let of_all = if group.world == World::ALL { &[] } else { self.of_all() };
        (self.members(group), of_all)
    }

    /// The boxes of all worlds.
    pub fn of_all(&self) -> &[u32] {
        let found = self.worlds.binary_search_by_key(&World::ALL, |group| group.world);
        found.map_or(&[], |at| self.members(&self.worlds[at]))
    }

    pub fn allocated_bytes(&self) -> usize {
        (self.members.capacity() + self.starts.capacity()) * size_of::<u32>()
            + self.worlds.capacity() * size_of::<Group>()
    }
}
