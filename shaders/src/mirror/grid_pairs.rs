//! `grid_pairs`: the words of each row, and its pairs.

use pairmask_core::aabb::{BoxClass, KeyBox};

use super::Mirrored;
use super::grid_cells::Home;
use super::grid_layout::{cell, coordinates, folded};
use crate::constants::NO_LEVEL;
use crate::layouts::{GridLayout, GridLevel};

/// Words by row and block, pairs by row and column, and how many pairs were compared for them.
pub(super) fn find(
    layout: &GridLayout,
    keys: &[(KeyBox, BoxClass)],
    overlap: &dyn Fn(usize, usize) -> bool,
    homes: &[Home],
    starts: &[u32],
    mirrored: &mut Mirrored,
) {
    let Mirrored { order, words, pairs, compared } = mirrored;
    let start = |cell: u32| starts[cell as usize];
    let giants = start(layout.first_giant)..start(layout.first_nothing);
    for (index, row) in order.iter().zip(0..) {
        let home = homes[*index as usize];
        if home.level == NO_LEVEL {
            continue;
        }
        let key = &keys[*index as usize].0;
        let mut runs = Vec::new();
        for (level, number) in
            layout.levels.iter().zip(0..layout.level_count).skip(home.level as usize)
        {
            level_runs(level, number == home.level, key, row, &start, &mut runs);
        }
        runs.push(giants.start.max(row + 1)..giants.end);
        assert!(
            runs.windows(2).all(|w| w[0].end <= w[1].start || w[0].is_empty() || w[1].is_empty())
        );
        for column in runs.into_iter().flatten() {
            *compared += 1;
            let other = order[column as usize];
            if !overlap(*index as usize, other as usize) {
                continue;
            }
            pairs.push([*index.min(&other), *index.max(&other)]);
            let (block, bit) = (column / 32, 1 << (column % 32));
            match words.last_mut() {
                Some([r, b, bits]) if (*r, *b) == (row, block) => *bits |= bit,
                _ => words.push([row, block, bit]),
            }
        }
    }
}

/// The runs of positions that a row looks at in a level, in rising order.
fn level_runs(
    level: &GridLevel,
    is_own: bool,
    key: &KeyBox,
    row: u32,
    start: &impl Fn(u32) -> u32,
    runs: &mut Vec<std::ops::Range<u32>>,
) {
    if start(level.first_cell) == start(level.first_cell + level.cell_count) {
        return;
    }
    let [min, max] = coordinates(key);
    let home: [u32; 3] = std::array::from_fn(|a| folded(level, a, cell(level, a, min[a])));
    let [xs, ys, zs]: [Vec<u32>; 3] = std::array::from_fn(|a| {
        let wraps = level.wraps >> a & 1 == 1;
        let (low, high) = (cell(level, a, min[a]) - 1, cell(level, a, max[a]));
        let around = (low..=high).filter(|c| wraps || *c >= 0).take(level.count[a] as usize);
        let mut cells: Vec<u32> = around.map(|c| folded(level, a, c)).collect();
        cells.sort_unstable();
        cells
    });
    let reaches = cell(level, 0, max[0]) > cell(level, 0, min[0]);
    let own_line = home[2] * level.count[1] + home[1];
    for z in &zs {
        for y in &ys {
            let line = z * level.count[1] + y;
            let first = level.first_cell + line * level.count[0];
            let run = |x: u32| start(first + x)..start(first + x + 1);
            if is_own && line < own_line {
                continue;
            }
            if is_own && line == own_line {
                runs.push(row + 1..run(home[0]).end);
                let last = level.count[0] - 1;
                if reaches && home[0] < last {
                    runs.push(run(home[0] + 1));
                }
                if level.wraps & 1 == 1 && home[0] == 0 {
                    runs.push(run(last));
                }
                continue;
            }
            runs.extend(xs.iter().map(|x| run(*x)));
        }
    }
}
