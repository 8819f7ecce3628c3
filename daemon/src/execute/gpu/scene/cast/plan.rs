//! Sizes of a tree in video memory, and of a search in it. Pure.

use pairmask_shaders::constants::{CAST_LANES, CAST_LEVELS};
use pairmask_shaders::layouts::CastLevel;

/// Items of a group.
const FAN_OUT: u64 = CAST_LANES as u64;

/// Most workgroups of a search. More rays or spheres take turns, so that a dispatch has one of few sizes.
const MOST_GROUPS: usize = 1 << 15;

/// The levels of a tree: where the items of each begin, and how many there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Levels {
    of: [[u32; 2]; CAST_LEVELS as usize],
    /// The one that has no more items than a group.
    pub top: u32,
}

impl Levels {
    /// Those of a tree of so many places.
    pub fn of(places: u32) -> Self {
        let mut levels = Self { of: [[0; 2]; CAST_LEVELS as usize], top: 0 };
        let (mut first, mut count) = (0, u64::from(places));
        for (at, level) in (0..).zip(&mut levels.of) {
            *level = [first as u32, count as u32];
            levels.top = at;
            if count <= FAN_OUT {
                break;
            }
            first += count;
            count = count.div_ceil(FAN_OUT);
        }
        levels
    }

    /// Items of a level.
    pub const fn count(&self, level: u32) -> u32 {
        self.of[level as usize][1]
    }

    /// Items of all levels.
    pub fn items(&self) -> u64 {
        self.of.iter().map(|level| u64::from(level[1])).sum()
    }

    /// Groups of boxes.
    pub const fn leaves(&self) -> u64 {
        (self.count(0) as u64).div_ceil(FAN_OUT)
    }

    pub fn layout(&self) -> [CastLevel; CAST_LEVELS as usize] {
        self.of.map(|[first, count]| CastLevel { first, count })
    }
}

/// Workgroups that look for so many rays or spheres.
pub(super) fn groups(queries: usize) -> u32 {
    queries.next_power_of_two().min(MOST_GROUPS) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_level_has_an_item_a_group_of_the_one_below() {
        let levels = Levels::of(1_000_000);
        let counts: Vec<u32> = (0..4).map(|level| levels.count(level)).collect();
        assert_eq!(counts, [1_000_000, 31_250, 977, 31]);
        assert_eq!((levels.top, levels.items(), levels.leaves()), (3, 1_032_258, 31_250));
        assert_eq!(levels.layout()[2].first, 1_031_250);
        for (places, top) in
            [(0, 0), (1, 0), (32, 0), (33, 1), (1_024, 1), (1_025, 2), (1 << 30, 5)]
        {
            assert_eq!(Levels::of(places).top, top, "{places}");
        }
    }

    #[test]
    fn many_rays_share_workgroups() {
        assert_eq!([1, 600, 1 << 20].map(groups), [1, 1_024, 1 << 15]);
    }
}
