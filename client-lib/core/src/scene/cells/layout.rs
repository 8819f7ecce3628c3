//! Which levels a scene gets, and how large their cells are.
//!
//! The model only steers: any layout gives the same pairs.

use super::axis::Axis;
use crate::aabb::Aabb;
use crate::engine::grid::{
    CELL_LIMIT, Density, Sample, SizeClass, cell_counts, folded, size_classes,
};
use crate::floats;

/// Time to begin a line of cells, in tests of an entry: its misses of the caches overlap with others'.
const LINE_COST: f32 = 8.0;
/// Largest shift of fine cells to cells.
const SHIFT_MOST: u32 = 8;
/// Most cells of a level, for each box of it: 4 bytes a cell.
const CELLS_A_BOX: f32 = 1.0;
/// Cells that a level may have however few its boxes are.
const CELLS_LEAST: f32 = 512.0;
/// Most cells of a level, so that those of all levels stay below 2^31.
const CELLS_MOST: f32 = 134_217_728.0;
/// Each spare level's cells against those of the level before.
const SPARE_GROWTH: f32 = 4.0;
/// Most spare levels: 4^8 = 65,536 times the size of the largest box that the sample saw.
const SPARE_MOST: usize = 8;

/// One grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub axes: [Axis; 3],
    /// Its first cell in the table of all levels.
    pub first_cell: u32,
}

impl Level {
    /// A level of one cell for whatever no other level takes.
    const EVERYTHING: Self = Self { axes: [Axis::WHOLE; 3], first_cell: 0 };

    /// Cells of the level.
    pub fn cell_count(&self) -> u32 {
        self.axes.iter().map(|axis| axis.count).product()
    }

    /// The cell of a box, or `None` where the box is too long for the level.
    #[inline(always)]
    pub fn home(&self, min: [f32; 3], max: [f32; 3]) -> Option<u32> {
        let low: [i32; 3] = std::array::from_fn(|axis| self.axes[axis].fine(min[axis]));
        let fits = (0..3)
            .fold(true, |fits, axis| fits & (self.axes[axis].fine(max[axis]) - low[axis] <= 1));
        let [x, y, z] = std::array::from_fn(|axis| self.axes[axis].cell(low[axis]));
        fits.then(|| self.cell_at(x, y, z))
    }

    /// The cell of the table at x, y, z.
    #[inline(always)]
    pub fn cell_at(&self, x: u32, y: u32, z: u32) -> u32 {
        self.first_cell + (z * self.axes[1].count + y) * self.axes[0].count + x
    }
}

/// The levels for some boxes, finest first; the last one takes everything. The same ones whatever the
/// flags of this thread.
pub(super) fn choose(boxes: &[Aabb]) -> Vec<Level> {
    floats::with_default(|| {
        let mut sample = Sample::default();
        sample.take(boxes);
        let mut levels = Vec::new();
        if !sample.boxes.is_empty() {
            let density = sample.density();
            let total = sample.boxes.len() as f32 * sample.weight;
            let mut edges = [0.0f32; 3];
            for class in size_classes(&sample, &density) {
                levels.push(level(&sample, &density, &class, total));
                edges = std::array::from_fn(|axis| edges[axis].max(class.least_edges[axis]));
            }
            for _ in 0..SPARE_MOST {
                edges = edges.map(|edge| edge * SPARE_GROWTH);
                if (0..3).all(|axis| edges[axis] >= sample.extent[axis]) {
                    break;
                }
                levels
                    .push(Level { axes: axes(&sample, edges, [0; 3], CELLS_LEAST), first_cell: 0 });
            }
        }
        levels.push(Level::EVERYTHING);
        let mut next = 0;
        for level in &mut levels {
            level.first_cell = next;
            next += level.cell_count();
        }
        levels
    })
}

/// The level of a class of boxes with the shifts that cost a search least.
fn level(sample: &Sample, density: &Density, class: &SizeClass, total: f32) -> Level {
    let limit = (class.share * total * CELLS_A_BOX).clamp(CELLS_LEAST, CELLS_MOST);
    let mut best = ([SHIFT_MOST; 3], f32::INFINITY);
    for shift_x in 0..=SHIFT_MOST {
        for shift in 0..=SHIFT_MOST {
            let shifts = [shift_x, shift, shift];
            let cost = search_cost(sample, density, class, shifts, limit);
            if cost < best.1 {
                best = (shifts, cost);
            }
        }
    }
    Level { axes: axes(sample, class.least_edges, best.0, limit), first_cell: 0 }
}

/// Cost of a search around a box of a class, in tests of an entry.
fn search_cost(
    sample: &Sample,
    density: &Density,
    class: &SizeClass,
    shifts: [u32; 3],
    limit: f32,
) -> f32 {
    let edges: [f32; 3] = std::array::from_fn(|a| class.least_edges[a] * (1 << shifts[a]) as f32);
    let counts = cell_counts(sample, edges);
    // Fine cells that a search spans are cell(min) − 1 to cell(max).
    let spans: [f32; 3] = std::array::from_fn(|a| {
        let fine = 1.0 + class.mean_edges[a] / class.least_edges[a];
        (1.0 + fine / (1 << shifts[a]) as f32).min(counts[a])
    });
    let entries = class.share * density.in_cell(std::array::from_fn(|a| spans[a] * edges[a]));
    // A table with more cells is folded: then each cell has boxes from several places.
    let folded = (counts.iter().product::<f32>() / limit).max(1.0);
    spans[1] * spans[2] * LINE_COST + entries * folded
}

/// Axes of fine cells of `fine_edges` over the sample's bounds, in at most `limit` cells.
fn axes(sample: &Sample, fine_edges: [f32; 3], shifts: [u32; 3], limit: f32) -> [Axis; 3] {
    let edges = std::array::from_fn(|axis| fine_edges[axis] * (1 << shifts[axis]) as f32);
    let counts = cell_counts(sample, edges);
    // The fine cells of an axis have to be countable too.
    let is_small = |axis: usize| counts[axis] * ((1 << shifts[axis]) as f32) < CELL_LIMIT;
    if counts.iter().product::<f32>() <= limit && (0..3).all(is_small) {
        return std::array::from_fn(|axis| {
            let (start, edge) = (sample.low[axis], fine_edges[axis]);
            Axis::clamped(start, edge, shifts[axis], counts[axis] as u32)
        });
    }
    let counts = folded(counts, limit);
    std::array::from_fn(|axis| {
        if counts[axis] < 4.0 {
            return Axis::WHOLE;
        }
        let (start, edge) = (sample.low[axis], fine_edges[axis]);
        Axis::wrapped(start, edge, shifts[axis], counts[axis] as u32)
    })
}
