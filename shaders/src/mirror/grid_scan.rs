//! `grid_scan`: the first position of each cell.

use super::Home;
use crate::layouts::GridLayout;

/// First position of each cell, then n.
pub(super) fn starts(layout: &GridLayout, homes: &[Home]) -> Vec<u32> {
    let mut starts = vec![0; layout.cell_end as usize + 1];
    for home in homes {
        starts[home.cell as usize] += 1;
    }
    let mut sum = 0;
    for start in &mut starts {
        sum += std::mem::replace(start, sum);
    }
    starts
}
