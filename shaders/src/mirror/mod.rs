//! The grid's stages on the CPU, one function a stage: what each leaves behind, word for word.
//!
//! Slow and plain. The tests compare the GPU's reply with it, byte by byte.

use pairmask::aabb::{BoxClass, KeyBox};
use pairmask::precision::NarrowBoxes;
use pairmask_shaders::constants::{NO_LEVEL, PARKED};
use pairmask_shaders::layouts::{GridLayout, GridLevel};

use super::axis::{cell, coordinates};
use super::layout::Chooser;

/// Where a box belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Home {
    /// Cell in the table of all levels.
    pub cell: u32,
    /// Level; one past the last for giants, `NO_LEVEL` for what overlaps nothing.
    pub level: u32,
}

/// What a frame leaves behind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mirrored {
    /// Home of each box.
    pub homes: Vec<Home>,
    /// First position of each cell, then n.
    pub starts: Vec<u32>,
    /// Box at each position.
    pub order: Vec<u32>,
    /// Row, column block and bits of each non-zero word.
    pub words: Vec<[u32; 3]>,
    /// Pairs compared.
    pub compared: u64,
}

/// All stages.
pub fn frame(boxes: NarrowBoxes<'_>) -> Mirrored {
    let layout = Chooser::default().choose(boxes);
    let expanded = (0..boxes.len()).filter_map(|i| boxes.get(i));
    let keys: Vec<(KeyBox, BoxClass)> = expanded.map(|b| KeyBox::classify(&b)).collect();
    let homes = homes(&layout, &keys);
    let starts = starts(&layout, &homes);
    let order = positions(&homes);
    let mut mirrored = Mirrored { homes, starts, order, ..Mirrored::default() };
    words(&layout, &keys, &mut mirrored);
    mirrored
}

/// `grid_cells`.
fn homes(layout: &GridLayout, keys: &[(KeyBox, BoxClass)]) -> Vec<Home> {
    let levels = &layout.levels[..layout.level_count as usize];
    let parked = |first: u32, index: u32, level| Home { cell: first + index / PARKED, level };
    let home = |((key, class), index): (&(KeyBox, BoxClass), u32)| {
        if *class != BoxClass::Solid {
            return parked(layout.first_nothing, index, NO_LEVEL);
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
        parked(layout.first_giant, index, layout.level_count)
    };
    keys.iter().zip(0..).map(home).collect()
}

fn folded(level: &GridLevel, axis: usize, cell: i32) -> u32 {
    (cell & level.fold[axis]) as u32
}

/// `grid_scan`.
fn starts(layout: &GridLayout, homes: &[Home]) -> Vec<u32> {
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

/// `grid_scatter` and `grid_place`.
fn positions(homes: &[Home]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..homes.len() as u32).collect();
    order.sort_by_key(|index| homes[*index as usize].cell);
    order
}

/// `grid_pairs` and `grid_write`.
fn words(layout: &GridLayout, keys: &[(KeyBox, BoxClass)], mirrored: &mut Mirrored) {
    let Mirrored { homes, starts, order, words, compared } = mirrored;
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
            if !key.overlaps(&keys[order[column as usize] as usize].0) {
                continue;
            }
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
