//! Which levels a scene gets and how large their cells are, from a sample.
//!
//! The model below counts what a row looks at; it only steers. Any layout gives the same pairs.

use pairmask_core::engine::grid::folded;
use pairmask_core::floats;
use pairmask_core::objects::Objects;
use pairmask_core::precision::BoxSlice;
use pairmask_shaders::constants::{GRID_LEVELS, UNPLACED_A_CELL};
use pairmask_shaders::layouts::{GridLayout, GridWorlds};

use super::axis::{self, Axis, CELL_LIMIT};
use super::sample::Sample;

/// Cells of boxes of one size are so much longer: rounding sends none to a coarser level.
const ALIKE_MARGIN: f32 = 1.001;
/// Where sizes differ, cells are this much longer than the longest edge that the sample saw: if
/// only ten boxes of a million go to a coarser level, all the others have to look there.
const MIXED_MARGIN: f32 = 1.02;
/// Cells of an axis that is not folded are longer by this share of it, too: both ends of a box are subtracted from and
/// multiplied, each rounded to 24 bits. In a row of a million cells that is a quarter of one, and boxes that cover
/// three cells by it would go to a coarser level, where all the others have to look.
const ROUNDING: f32 = 1.0 / 4_194_304.0;
/// Sizes that differ by less are one size.
const ALIKE_SIZES: f32 = 1.0005;
/// Share of the extent by which the table reaches beyond what the sample saw, on either side.
const BOUNDS_MARGIN: f32 = 1.0 / 256.0;
/// The same for a row of cells: what lies beyond shares one cell at either end, and not those of a face.
const ROW_MARGIN: f32 = 1.0 / 16.0;

/// Most cells of a level for each of its boxes: a uniform scene with a pair a box has 4.3.
const CELLS_A_BOX: u64 = 6;
/// Cells that a level may have however few its boxes are.
const CELLS_LEAST: u64 = 512;

/// Boxes that each of several worlds must have on average for a grid of its own: a level has six cells a box
/// and there may be sixteen levels. Smaller worlds are a matter of all pairs.
pub(super) const WORLD_BOXES_LEAST: u32 = 8;

/// Levels for the boxes of the sample; the rest is for larger ones.
const SAMPLED_LEVELS: usize = 11;
/// Each spare level's cells against those of the level before.
const SPARE_GROWTH: f32 = 4.0;

/// Octaves of sizes below the largest that are distinguished.
const OCTAVES: usize = 24;

/// Cost of looking up a run of cells, in tests of a pair.
const RUN_COST: f32 = 2.0;
/// Cost of another level to look at.
const LEVEL_COST: f32 = 3.0;

/// Most entries of the table of cells for `n` boxes: a function of n alone, so that buffers and
/// dispatches are known before the boxes are.
pub(in crate::execute::gpu) const fn cells_most(n: u32) -> u64 {
    CELLS_A_BOX * n as u64 + CELLS_LEAST * GRID_LEVELS as u64 + 2 * parking_cells(n) as u64 + 1
}

/// Cells of boxes that lie there by their index.
const fn parking_cells(n: u32) -> u32 {
    n / UNPLACED_A_CELL + 1
}

/// Boxes of one octave of sizes, or of several.
#[derive(Clone, Copy, Debug, Default)]
struct Group {
    count: f32,
    edges: [f32; 3],
}

impl Group {
    fn with(self, other: Self) -> Self {
        let edges = std::array::from_fn(|axis| self.edges[axis].max(other.edges[axis]));
        Self { count: self.count + other.count, edges }
    }
}

#[derive(Default)]
pub(in crate::execute::gpu) struct Chooser {
    sample: Sample,
}

impl Chooser {
    /// The layout for a scene: the same one regardless of the floating-point flags of this thread.
    pub fn choose<'a>(&mut self, objects: impl Into<Objects<'a>>) -> GridLayout {
        let objects = objects.into();
        floats::with_default(|| {
            self.sample.take(objects);
            let n = objects.len() as u32;
            self.choose_levels(&Room::of_scene(n), parking_cells(n))
        })
    }

    /// The same where the boxes are of so many worlds, each of which gets cells of its own. `None` where so
    /// many worlds have too few boxes each for a grid.
    pub fn choose_worlds<'a>(
        &mut self,
        objects: impl Into<Objects<'a>>,
        worlds: u32,
    ) -> Option<GridLayout> {
        let objects = objects.into();
        let n = objects.len() as u32;
        let in_world = n / worlds.max(1);
        if worlds < 2 {
            let layout = self.choose(objects);
            let worlds = GridWorlds {
                cells: layout.cell_end,
                parking: parking_cells(n),
                count: 1,
                padding: 0,
            };
            return Some(GridLayout { worlds, ..layout });
        }
        if in_world < WORLD_BOXES_LEAST {
            return None;
        }
        floats::with_default(|| {
            self.sample.take(objects);
            self.sample.valid /= worlds as f32;
            // As many as one world of `n` boxes may have.
            let cells = (cells_most(n) - 1) / u64::from(worlds);
            let parking = parking_cells(in_world);
            let most = cells - 2 * u64::from(parking);
            let least = (most / (4 * u64::from(GRID_LEVELS))).max(1);
            let mut layout = self.choose_levels(&Room { most, least }, parking);
            let cells = layout.cell_end;
            layout.worlds = GridWorlds { cells, parking, count: worlds, padding: 0 };
            layout.cell_end = cells * worlds;
            debug_assert!(u64::from(layout.cell_end) < cells_most(n));
            Some(layout)
        })
    }

    /// The same for a scene of `n` boxes, some of which these are.
    pub fn choose_for(&mut self, some: BoxSlice<'_>, n: u32) -> GridLayout {
        floats::with_default(|| {
            self.sample.take(some.into());
            self.sample.valid *= n as f32 / some.len().max(1) as f32;
            self.choose_levels(&Room::of_scene(n), parking_cells(n))
        })
    }

    fn choose_levels(&mut self, room: &Room, parking: u32) -> GridLayout {
        let mut layout = GridLayout::default();
        let mut cells = 0;
        let mut top = [0.0f32; 3];
        let octaves = octaves(&self.sample);
        let margin = if self.sample.is_alike(ALIKE_SIZES) { ALIKE_MARGIN } else { MIXED_MARGIN };
        for group in groups(&self.sample, &octaves).into_iter().flatten() {
            top = cell_edges(&self.sample, group.edges, margin);
            let share = group.count / self.sample.boxes.len().max(1) as f32;
            let boxes = share * self.sample.valid;
            let axes = axes(&self.sample, top, boxes, room.least, room.left(&layout, cells));
            push(&mut layout, &mut cells, axes);
        }
        // Coarser levels for the few boxes that are larger than any that the sample saw.
        while layout.level_count > 0
            && layout.level_count < GRID_LEVELS
            && (0..3).any(|axis| top[axis] < self.sample.extent[axis])
        {
            top = top.map(|edge| edge * SPARE_GROWTH);
            let axes = axes(&self.sample, top, 0.0, room.least, room.left(&layout, cells));
            push(&mut layout, &mut cells, axes);
        }
        layout.first_giant = cells;
        layout.first_nothing = cells + parking;
        layout.cell_end = layout.first_nothing + parking;
        debug_assert!(u64::from(cells) <= room.most);
        layout
    }
}

/// Cells that there is room for in the table.
struct Room {
    most: u64,
    /// Of a level, however few its boxes are.
    least: u64,
}

impl Room {
    /// So many that all levels of `n` boxes fit [`cells_most`].
    fn of_scene(n: u32) -> Self {
        let most = CELLS_A_BOX * u64::from(n) + CELLS_LEAST * u64::from(GRID_LEVELS);
        Self { most, least: CELLS_LEAST }
    }

    fn left(&self, layout: &GridLayout, cells: u32) -> u64 {
        let later_levels = u64::from(GRID_LEVELS - 1 - layout.level_count);
        self.most - u64::from(cells) - self.least * later_levels
    }
}

fn push(layout: &mut GridLayout, cells: &mut u32, axes: [Axis; 3]) {
    let level = axis::level(axes, *cells);
    *cells += level.cell_count;
    layout.levels[layout.level_count as usize] = level;
    layout.level_count += 1;
}

/// Boxes by octave of size, smallest first; the last is within a factor of two of the largest.
fn octaves(sample: &Sample) -> [Group; OCTAVES] {
    let mut octaves = [Group::default(); OCTAVES];
    let largest = sample.boxes.iter().map(|b| b.size).fold(0.0, f32::max);
    for b in &sample.boxes {
        // Whole octaves below the largest, by the exponent; sizes are no NaN, and may be 0.
        let below = if b.size > 0.0 { (largest / b.size).log2() } else { OCTAVES as f32 };
        let octave = OCTAVES - 1 - (below.max(0.0) as usize).min(OCTAVES - 1);
        octaves[octave] = octaves[octave].with(Group { count: 1.0, edges: b.edges });
    }
    octaves
}

/// The cheapest way to share the octaves among levels, finest first. Dynamic programming over
/// where a level ends: what a level costs depends on its own boxes and on how many are finer.
fn groups(sample: &Sample, octaves: &[Group; OCTAVES]) -> [Option<Group>; SAMPLED_LEVELS] {
    // Best cost of the octaves before each border, the border before it, and levels so far.
    let mut best = [(f32::INFINITY, 0usize, 0usize); OCTAVES + 1];
    let first = octaves.iter().position(|o| o.count > 0.0).unwrap_or(OCTAVES);
    best[first] = (0.0, first, 0);
    let mut finer = 0.0;
    for start in first..OCTAVES {
        let (cost, _, levels) = best[start];
        if cost.is_finite() && levels < SAMPLED_LEVELS {
            let mut group = Group::default();
            for (end, octave) in (start + 1..).zip(&octaves[start..]) {
                group = group.with(*octave);
                let cost = cost + level_cost(sample, &group, finer);
                // Levels end at an octave that has boxes, or at the last.
                if octave.count > 0.0 && cost < best[end].0 {
                    best[end] = (cost, start, levels + 1);
                } else if octave.count == 0.0 && best[end - 1].0 < best[end].0 {
                    best[end] = best[end - 1];
                }
            }
        }
        finer += octaves[start].count;
    }
    let mut found = [None; SAMPLED_LEVELS];
    let mut end = OCTAVES;
    while end > first && best[end].0.is_finite() {
        let (_, start, levels) = best[end];
        let group = octaves[start..end].iter().fold(Group::default(), |g, o| g.with(*o));
        if levels == 0 || group.count == 0.0 {
            break;
        }
        found[levels - 1] = Some(group);
        end = start;
    }
    found
}

/// What a level costs all boxes that look at it: `group` its own, `finer` those of finer levels.
fn level_cost(sample: &Sample, group: &Group, finer: f32) -> f32 {
    let edges = cell_edges(sample, group.edges, MIXED_MARGIN);
    // Cells around a box along each axis: where the scene is one cell deep, one.
    let around = |axis: usize, cells: f32| {
        if edges[axis] < sample.extent[axis] { cells } else { 1.0 }
    };
    let crowd: f32 = (0..3)
        .map(|axis| (edges[axis] / sample.extent[axis].max(f32::MIN_POSITIVE)).min(1.0))
        .product();
    let in_cell = sample.valid * group.count / sample.boxes.len().max(1) as f32 * crowd;
    let own_runs = 0.5 * (around(1, 3.0) * around(2, 3.0) + 1.0);
    let own_cells = 0.5 * around(0, 3.0) * around(1, 3.0) * around(2, 3.0);
    let runs = around(1, 2.0) * around(2, 2.0);
    let own = RUN_COST * own_runs + in_cell * own_cells;
    let across = LEVEL_COST + runs * (RUN_COST + in_cell * around(0, 2.0));
    group.count * own + finer * across
}

fn cell_edges(sample: &Sample, edges: [f32; 3], margin: f32) -> [f32; 3] {
    std::array::from_fn(|axis| {
        // Flat boxes: any cell holds them, so take what the scene has room for.
        let least = sample.extent[axis] / 1024.0;
        let edge = if edges[axis] > 0.0 { edges[axis] * margin } else { least };
        edge.max(f32::MIN_POSITIVE)
    })
}

/// Axes of a level for about `boxes` boxes: `least` cells, if of use, and `room` at most.
fn axes(sample: &Sample, edges: [f32; 3], boxes: f32, least: u64, room: u64) -> [Axis; 3] {
    let limit = (CELLS_A_BOX * boxes as u64).max(least).min(room);
    let is_row = (0..3).filter(|axis| edges[*axis] < sample.extent[*axis]).count() == 1;
    let share = if is_row { ROW_MARGIN } else { BOUNDS_MARGIN };
    let margin = sample.extent.map(|extent| extent * share);
    let width = |axis: usize| sample.extent[axis] + 2.0 * margin[axis];
    let count = |axis: usize, edge: f32| {
        if edge >= sample.extent[axis] {
            return 1;
        }
        (width(axis) / edge).clamp(0.0, CELL_LIMIT - 1.0) as u64 + 1
    };
    let counts: [u64; 3] = std::array::from_fn(|axis| count(axis, edges[axis]));
    if counts.iter().product::<u64>() <= limit && !sample.has_far {
        return std::array::from_fn(|axis| {
            if counts[axis] == 1 {
                return Axis::clamped(sample.low[axis], edges[axis], 1);
            }
            let edge = edges[axis] + width(axis) * ROUNDING;
            Axis::clamped(sample.low[axis] - margin[axis], edge, count(axis, edge) as u32)
        });
    }
    // Too wide for a table, or boxes lie far beyond it, which would crowd its last cells.
    // A spare level has none of the sampled boxes.
    let sampled = if boxes > 0.0 { sample.mins.as_slice() } else { &[] };
    let counts = counts.map(|count| count as f32);
    let counts = folded(sampled.iter().copied(), edges, counts, limit as f32);
    std::array::from_fn(|axis| match counts[axis] {
        1 => Axis::clamped(sample.low[axis], edges[axis], 1),
        count => Axis::folded(sample.middle[axis], edges[axis], count),
    })
}

#[cfg(test)]
mod tests {
    use pairmask_core::Aabb;
    use pairmask_core::engine::grid::FOLDED_LEAST;
    use pairmask_shaders::mirror::grid_layout::cell;
    use pairmask_tests::stress_scenes::{self, Rng};

    use super::*;

    #[test]
    fn every_layout_fits_the_table_and_has_a_level_for_what_the_sample_saw() {
        let mut chooser = Chooser::default();
        for scene in stress_scenes::ALL {
            for n in (0..70).chain([345, 1234, 20_000]) {
                let layout = chooser.choose(BoxSlice::from(&scene.boxes(n, 7)));
                assert!(u64::from(layout.cell_end) < cells_most(n), "{scene:?}, {n} boxes");
                let mut next = 0;
                for level in &layout.levels[..layout.level_count as usize] {
                    assert_eq!(level.first_cell, next, "{scene:?}");
                    next += level.cell_count;
                    for axis in 0..3 {
                        let folded = level.wraps >> axis & 1 == 1;
                        assert!(!folded || level.count[axis] >= FOLDED_LEAST, "{scene:?}");
                        assert_eq!(folded, level.fold[axis] >= 0, "{scene:?}");
                    }
                }
                assert_eq!(layout.first_giant, next);
            }
        }
    }

    #[test]
    fn boxes_of_one_size_get_one_level_and_spares() {
        let mut chooser = Chooser::default();
        let uniform = stress_scenes::named("uniform").boxes(10_000, 3);
        let layout = chooser.choose(BoxSlice::from(&uniform));
        let cells = layout.levels[0].cell_count;
        assert!((20_000..60_000).contains(&cells), "{cells}");
        let edge = uniform[0].max[0] - uniform[0].min[0];
        let cell = 1.0 / layout.levels[0].scale[0];
        assert!(edge < cell && cell < 1.01 * edge, "{edge} {cell}");
        let top = &layout.levels[layout.level_count as usize - 1];
        assert!(top.count.iter().all(|count| *count <= 2), "{top:?}");
    }

    /// A row of a million boxes: none may cover three cells because its ends were rounded, and no cell is crowded.
    #[test]
    fn boxes_of_a_long_row_are_in_the_level_that_is_theirs() {
        let mut rng = Rng::new(3);
        let boxes: Vec<Aabb> = (0..1_000_000)
            .map(|_| {
                let x = rng.unit() * 1.9e6;
                Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0])
            })
            .collect();
        let layout = Chooser::default().choose(BoxSlice::from(&boxes));
        let level = &layout.levels[0];
        assert!(level.count[0] > 1_000_000 && level.wraps == 0, "{level:?}");
        let spans = |b: &Aabb| cell(level, 0, b.max[0]) - cell(level, 0, b.min[0]);
        assert_eq!(boxes.iter().filter(|b| spans(b) > 1).count(), 0);
        let mut counts = vec![0; level.count[0] as usize];
        for b in &boxes {
            counts[cell(level, 0, b.min[0]) as usize] += 1;
        }
        let most = counts.iter().max().expect("cells");
        assert!(*most < 20, "{most} boxes in a cell");
    }

    #[test]
    fn boxes_of_many_sizes_get_levels_of_rising_cells() {
        let boxes = stress_scenes::named("sizes over 20 octaves").boxes(20_000, 3);
        let layout = Chooser::default().choose(BoxSlice::from(&boxes));
        let levels = &layout.levels[..layout.level_count as usize];
        assert!(levels.len() >= 3, "{}", levels.len());
        assert!(levels.windows(2).all(|w| w[0].scale[0] > w[1].scale[0]));
    }
}
