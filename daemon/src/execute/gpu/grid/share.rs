//! How several GPUs share a frame. Pure.
//!
//! The rows of a frame are in the order of their home cells, so a range of cells is a slab of the scene:
//! each GPU has the rows of one range, in each level of those that the range reaches into. All GPUs count
//! the boxes of all cells, so that a box has the same position everywhere, and each places the boxes that
//! its rows look at. A pair is found by the row that finds it on a single GPU, so it is found once, and
//! all items one behind the other are those of a single GPU: the same bytes, whatever the borders are.
//!
//! (Avril et al. 2014, §5 divide a scene among GPUs by slabs as well. Theirs report a pair by the lower
//! corner of the intersection, and merge.)

use pairmask_core::precision::BoxSlice;
use pairmask_shaders::layouts::{GridLayout, GridLevel, GridShare};
use pairmask_shaders::mirror;

/// Boxes by whose home cells borders are drawn, of those that are looked at: one of 256 is 0.4 % of the
/// rows.
const SAMPLE: usize = 256;
/// How far borders move towards where the last frame would have had them: all the way would swing where
/// the scene moves by itself.
const STEP: f32 = 0.5;
/// Work of a row without candidates: it is placed, and looked up in the table of cells (an H200: about as
/// long as for 16 tests).
const ROW_TESTS: u64 = 16;
/// Work of an item, which crosses the link (an H200: about as long as for 16 tests).
const ITEM_TESTS: u64 = 16;

/// What a GPU did of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShareWork {
    /// Rows.
    pub rows: u64,
    /// Pairs that were compared for them.
    pub compared: u64,
    /// Mask words or pairs that they found.
    pub items: u64,
}

impl ShareWork {
    fn tests(&self) -> u64 {
        ROW_TESTS * self.rows + self.compared + ITEM_TESTS * self.items
    }
}

/// Borders between the shares of GPUs, which move from frame to frame so that work is equal.
#[derive(Clone, Debug, PartialEq)]
pub struct Borders {
    /// Which part of the rows comes before each border: rising, without the ends 0 and 1.
    before: Vec<f32>,
}

impl Borders {
    /// Equal numbers of rows for so many GPUs.
    pub fn new(gpus: usize) -> Self {
        let gpus = gpus.max(1);
        Self { before: (1..gpus).map(|at| at as f32 / gpus as f32).collect() }
    }

    /// GPUs.
    pub const fn gpus(&self) -> usize {
        self.before.len() + 1
    }

    /// The share of each GPU in a frame of this layout.
    pub fn shares(&self, layout: &GridLayout, boxes: BoxSlice<'_>) -> Vec<GridShare> {
        let n = boxes.len();
        let wanted = n.min(SAMPLE);
        let mut cells: Vec<u32> = (0..wanted)
            .filter_map(|at| boxes.get(at * n / wanted))
            .map(|b| mirror::home_cell(layout, &b))
            .collect();
        cells.sort_unstable();
        let border = |before: &f32| {
            let at = (before * cells.len() as f32) as usize;
            cells.get(at).map_or(layout.cell_end, |cell| cell + 1)
        };
        let inner = self.before.iter().map(border);
        let borders: Vec<u32> = [0].into_iter().chain(inner).chain([layout.cell_end]).collect();
        borders.windows(2).map(|ends| share(layout, ends[0], ends[1])).collect()
    }

    /// Moves the borders by what each GPU did.
    pub fn note(&mut self, works: &[ShareWork]) {
        let all: u64 = works.iter().map(ShareWork::tests).sum();
        if works.len() != self.gpus() || all == 0 {
            return;
        }
        let ends: Vec<f32> =
            [0.0].into_iter().chain(self.before.iter().copied()).chain([1.0]).collect();
        // Where the work of the first GPUs is equal to that of the others, if it is even in each share.
        let even = |number: usize| {
            let mut left = all as f32 * number as f32 / works.len() as f32;
            for (work, ends) in works.iter().zip(ends.windows(2)) {
                let tests = work.tests() as f32;
                if left < tests {
                    return ends[0] + (ends[1] - ends[0]) * left / tests;
                }
                left -= tests;
            }
            1.0
        };
        let moved: Vec<f32> = (1..self.gpus()).map(even).collect();
        for (before, moved) in self.before.iter_mut().zip(moved) {
            *before += STEP * (moved - *before);
        }
    }
}

/// The share of a GPU whose rows have their homes in these cells.
fn share(layout: &GridLayout, first_cell: u32, end_cell: u32) -> GridShare {
    let mut share = GridShare { first_cell, end_cell, ..GridShare::default() };
    let mut has_finer_rows = false;
    for (level, looked_at) in
        layout.levels.iter().zip(&mut share.looked_at).take(layout.level_count as usize)
    {
        let end = level.first_cell + level.cell_count;
        let (own_first, own_end) = (first_cell.max(level.first_cell), end_cell.min(end));
        let has_rows = own_first < own_end;
        *looked_at = if has_finer_rows {
            // A row looks at all around it in coarser levels.
            [level.first_cell, end, 0, 0]
        } else if has_rows {
            let last = last_plane(level, own_first);
            [own_first, end.min(own_end.saturating_add(reach(level, own_end))), last[0], last[1]]
        } else {
            [0; 4]
        };
        has_finer_rows |= has_rows;
    }
    share
}

/// How many cells further rows look in their own level, of which the last is in the cell before `own_end`:
/// one on each axis. Where an axis is folded, to the end of the next plane.
fn reach(level: &GridLevel, own_end: u32) -> u32 {
    let [width, height, depth] = level.count;
    let plane = width * height;
    if level.wraps != 0 {
        let within = (own_end - 1 - level.first_cell) % plane;
        return plane - 1 - within + plane;
    }
    let beyond = |cells: u32, step: u32| if cells > 1 { step } else { 0 };
    beyond(depth, plane) + beyond(height, width) + 1
}

/// The plane that rows of the first plane look at across the end of a folded level: from, and up to before.
/// Rows of other planes have the plane before theirs as an earlier one, which looks at them.
fn last_plane(level: &GridLevel, own_first: u32) -> [u32; 2] {
    let [width, height, depth] = level.count;
    let plane = width * height;
    let is_folded = level.wraps >> 2 & 1 == 1;
    if is_folded && own_first - level.first_cell < plane {
        [level.first_cell + (depth - 1) * plane, level.first_cell + depth * plane]
    } else {
        [0, 0]
    }
}

/// Whether the rows of a share look at a cell of a level.
#[cfg(test)]
fn looks_at(share: &GridShare, level: u32, cell: u32) -> bool {
    share
        .looked_at
        .get(level as usize)
        .is_some_and(|at| (at[0]..at[1]).contains(&cell) || (at[2]..at[3]).contains(&cell))
}

#[cfg(test)]
mod tests {
    use pairmask_core::Aabb;

    use super::super::grid_layout;
    use super::*;

    fn scene(kind: u64, n: usize) -> Vec<Aabb> {
        let mut state = kind;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        let mut one = |at: usize| {
            let size = match kind % 4 {
                0 => 1.0,
                1 => {
                    if at.is_multiple_of(9) {
                        20.0
                    } else {
                        1.0
                    }
                }
                2 => 0.2 + random(),
                _ => {
                    if at.is_multiple_of(50) {
                        f32::INFINITY
                    } else {
                        0.5
                    }
                }
            };
            let flat = if kind % 3 == 1 { 0.0 } else { 1.0 };
            let min = [random() * 60.0, random() * 60.0 * flat, random() * 60.0];
            let mut max = min.map(|x| x + size);
            if at.is_multiple_of(37) {
                max[0] = min[0] - 1.0;
            }
            Aabb { min, max }
        };
        (0..n).map(&mut one).collect()
    }

    /// The mirror's pairs, row by row, by the GPU that has the row; every column must be placed there.
    #[test]
    fn each_row_has_one_gpu_and_all_that_it_looks_at() {
        for kind in 0..12 {
            for n in [2, 69, 1_500] {
                let boxes = scene(kind, n);
                let layout = grid_layout(BoxSlice::from(&boxes));
                let whole = mirror::frame(&layout, (&boxes).into());
                for gpus in 1..=4 {
                    let shares = Borders::new(gpus).shares(&layout, (&boxes).into());
                    assert_eq!(shares.len(), gpus);
                    let of_cell = |cell: u32| {
                        let has =
                            |share: &&GridShare| (share.first_cell..share.end_cell).contains(&cell);
                        assert_eq!(shares.iter().filter(has).count(), 1, "cell {cell}");
                        shares.iter().find(has).expect("one")
                    };
                    let is_placed = |share: &GridShare, index: u32| {
                        let home = whole.homes[index as usize];
                        home.level == layout.level_count || looks_at(share, home.level, home.cell)
                    };
                    for [row, block, bits] in &whole.words {
                        let index = whole.order[*row as usize];
                        let share = of_cell(whole.homes[index as usize].cell);
                        assert!(is_placed(share, index), "its own row");
                        for bit in (0..32).filter(|bit| bits >> bit & 1 == 1) {
                            let column = whole.order[(32 * block + bit) as usize];
                            assert!(
                                is_placed(share, column),
                                "kind {kind}, {n} boxes, {gpus} GPUs"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_share_places_little_more_than_its_part() {
        let boxes = scene(0, 20_000);
        let layout = grid_layout(BoxSlice::from(&boxes));
        let homes = mirror::frame(&layout, (&boxes).into()).homes;
        for share in Borders::new(2).shares(&layout, (&boxes).into()) {
            let placed = homes.iter().filter(|home| looks_at(&share, home.level, home.cell));
            let placed = placed.count();
            assert!((8_000..13_000).contains(&placed), "{placed} of 20,000");
        }
    }

    #[test]
    fn borders_move_to_where_work_is_equal_and_stay_there() {
        let mut borders = Borders::new(2);
        // Three quarters of the work are in the first tenth of the rows.
        let work = |from: f32, to: f32| {
            let at = |x: f32| if x < 0.1 { 7.5 * x } else { 0.75 + (x - 0.1) * 0.25 / 0.9 };
            ShareWork { compared: ((at(to) - at(from)) * 1e6) as u64, ..ShareWork::default() }
        };
        for _ in 0..60 {
            let border = borders.before[0];
            borders.note(&[work(0.0, border), work(border, 1.0)]);
        }
        assert!((borders.before[0] - 0.5 / 7.5).abs() < 0.01, "{borders:?}");
        let before = borders.clone();
        borders.note(&[ShareWork::default(); 2]);
        borders.note(&[work(0.0, 1.0)]);
        assert_eq!(borders, before, "nothing to learn of no work, or of other GPUs");
    }
}
