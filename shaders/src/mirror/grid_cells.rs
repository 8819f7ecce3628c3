//! `grid_cells`: the home cell of each box.

use pairmask_core::aabb::{BoxClass, KeyBox};

use super::grid_layout::{cell, coordinates, folded};
use crate::constants::{NO_LEVEL, UNPLACED_A_CELL};
use crate::layouts::GridLayout;

/// Where a box belongs.
#[derive(Clone, Copy)]
pub(super) struct Home {
    /// Cell in the table of all levels.
    pub cell: u32,
    /// Level; one past the last for giants, `NO_LEVEL` for what overlaps nothing.
    pub level: u32,
}

/// Home of each box.
pub(super) fn homes(layout: &GridLayout, keys: &[(KeyBox, BoxClass)]) -> Vec<Home> {
    let levels = &layout.levels[..layout.level_count as usize];
    let disabled =
        |first: u32, index: u32, level| Home { cell: first + index / UNPLACED_A_CELL, level };
    let home = |((key, class), index): (&(KeyBox, BoxClass), u32)| {
        if *class != BoxClass::Valid {
            return disabled(layout.first_nothing, index, NO_LEVEL);
        }
        let [min, max] = coordinates(key);
        for (level, number) in levels.iter().zip(0..) {
            let spans = (0..3).map(|a| cell(level, a, max[a]) - cell(level, a, min[a]));
            if spans.max().unwrap_or(0) <= 1 {
                let [x, y, z] = std::array::from_fn(|a| folded(level, a, cell(level, a, min[a])));
                let line = z * level.count[1] + y;
                return Home { cell: level.first_cell + line * level.count[0] + x, level: number };
            }
        }
        disabled(layout.first_giant, index, layout.level_count)
    };
    keys.iter().zip(0..).map(home).collect()
}
