//! Which levels a scene gets, and how large their cells are.
//!
//! The model only steers: any layout gives the same pairs.

use super::axis::{Axis, CELL_BITS, LONGEST};
use super::block::SLOTS;
use super::quanta::{QUANTUM_LIMIT, Quanta, Scale};
use crate::aabb::Aabb;
use crate::engine::grid::{Density, Sample, SizeClass, cell_counts, folded, size_classes};
use crate::floats;

/// Time to begin a line of cells, in tests of a block. The misses of the caches overlap with others'.
const LINE_COST: f32 = 1.2;
/// Time to look a cell up.
const CELL_COST: f32 = 0.3;
/// Boxes may be so much longer than the longest of the sample: a box that moves is found as the hull
/// of where it was and is.
const HULL_GROWTH: f32 = 1.1;
/// Lengths of cells that are tried, of the longest box: from a half, each so many times the one before.
const EDGE_LEAST: f32 = 0.5;
const EDGE_GROWTH: f32 = std::f32::consts::SQRT_2;
const EDGES: i32 = 12;
/// Most cells of a level, for each box of it: 12 bytes a cell.
const CELLS_A_BOX: f32 = 0.7;
/// Share of all boxes that cells for those far away are made for, however few these are.
const FAR_SHARE: f32 = 0.125;
/// Cells that a level may have however few its boxes are.
const CELLS_LEAST: f32 = 512.0;
/// Most cells of a level, so that those of all levels stay below 2^31.
const CELLS_MOST: f32 = 134_217_728.0;
/// Each spare level's cells against those of the level before.
const SPARE_GROWTH: f32 = 4.0;
/// Most spare levels: 4^8 = 65,536 times the size of the largest box that the sample saw.
const SPARE_MOST: usize = 8;

#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub axes: [Axis; 3],
    scale: Scale,
    /// Quanta of the longest boxes; the last lane does not count.
    reach: [i32; 4],
    /// Least and largest min of its boxes, in quanta: what lies far away is of another level.
    mins: [[i32; 4]; 2],
    /// The last cell on each axis.
    last: [i32; 4],
    /// Whether boxes are compared by quanta, and no cell is folded.
    is_plain: bool,
    /// Its first cell in the table of all levels.
    pub first_cell: u32,
    /// Whether it takes what no other level takes: boxes of any length, which are not compared by
    /// quanta.
    pub takes_all: bool,
}

/// Where a search goes in a level: from one cell to another on each axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Around {
    pub q: Quanta,
    pub first: [i32; 4],
    pub last: [i32; 4],
    /// As [`Axis::are_bounded`], on all axes.
    pub is_bounded: bool,
}

impl Level {
    /// A level of one cell for all that no other level takes.
    fn of_everything() -> Self {
        Self { takes_all: true, is_plain: false, ..Self::of_axes([Axis::WHOLE; 3]) }
    }

    fn of_axes(axes: [Axis; 3]) -> Self {
        let lanes = |of: fn(&Axis) -> f32| -> [f32; 4] {
            std::array::from_fn(|axis| axes.get(axis).map_or(0.0, of))
        };
        let scale = Scale { origin: lanes(|a| a.origin), per_unit: lanes(|a| a.per_unit) };
        let reach = std::array::from_fn(|axis| axes.get(axis).map_or(i32::MAX, |a| a.reach));
        let last = std::array::from_fn(|axis| axes.get(axis).map_or(0, |a| a.count as i32 - 1));
        let is_plain = !axes.iter().any(|axis| axis.wraps);
        let mins = [[i32::MIN; 4], [i32::MAX; 4]];
        Self { axes, scale, reach, mins, last, is_plain, first_cell: 0, takes_all: false }
    }

    /// A level of cells of some edges, for boxes of up to `longest`.
    fn new(sample: &Sample, edges: [f32; 3], longest: [f32; 3], limit: f32) -> Self {
        // So that no near box is beyond the last quantum, on either side of the middle.
        let edges = sample.edges_for(edges, QUANTUM_LIMIT / (1 << CELL_BITS) as f32);
        let counts = cell_counts(sample, edges);
        if counts.iter().product::<f32>() <= limit && !sample.has_far {
            let axes = std::array::from_fn(|axis| {
                Axis::clamped(sample.low[axis], edges[axis], longest[axis], counts[axis] as u32)
            });
            return Self::of_axes(axes);
        }
        let (counts, middle) = (folded(sample.near_mins(), edges, counts, limit), sample.middle());
        let axes = std::array::from_fn(|axis| {
            Axis::wrapped(middle[axis], edges[axis], longest[axis], counts[axis])
        });
        Self::of_axes(axes)
    }

    /// The same for boxes alone that do not lie far from all others.
    fn near(mut self, sample: &Sample, edges: [f32; 3]) -> Self {
        let near = [0, 1, 2].map(|axis| sample.near_on(axis, edges[axis]));
        let [low, high] = [0, 1].map(|end| near.map(|near| near.map_or(0.0, |ends| ends[end])));
        let Quanta { min, max } = self.quanta(&Aabb { min: low, max: high });
        for axis in (0..3).filter(|axis| near[*axis].is_some()) {
            (self.mins[0][axis], self.mins[1][axis]) = (min[axis], max[axis]);
        }
        self
    }

    /// A level for boxes that lie far from all others, where the sample has some.
    fn of_far(sample: &mut Sample) -> Option<Self> {
        let far = sample.far()?;
        // More may follow them.
        let most = far.count.max(FAR_SHARE * sample.boxes.len() as f32 * sample.weight);
        let limit = (CELLS_A_BOX * most).clamp(CELLS_LEAST, CELLS_MOST);
        let (edges, counts) = far.cells(HULL_GROWTH, limit);
        // For boxes up to as long as a cell, few as they are.
        Some(Self::of_axes(std::array::from_fn(|axis| {
            Axis::wrapped(far.middle[axis], edges[axis], edges[axis], counts[axis])
        })))
    }

    pub fn cell_count(&self) -> u32 {
        self.axes.iter().map(|axis| axis.count).product()
    }

    /// A valid box in quanta of the level.
    #[inline(always)]
    pub fn quanta(&self, b: &Aabb) -> Quanta {
        self.scale.quanta(b)
    }

    /// Where a search around a valid box goes: as [`Axis::cells`] on each axis, without branches. `None` where
    /// the level takes all, or is folded.
    #[inline(always)]
    pub fn around(&self, b: &Aabb) -> Option<Around> {
        if !self.is_plain {
            return None;
        }
        let q = self.quanta(b);
        let (mut first, mut last, mut is_bounded) = ([0; 4], [0; 4], true);
        for axis in 0..3 {
            let most = self.last[axis];
            first[axis] = ((q.min[axis] - self.reach[axis]) >> CELL_BITS).clamp(0, most);
            last[axis] = (q.max[axis] >> CELL_BITS).clamp(0, most);
            is_bounded &= first[axis] > 0;
            is_bounded &= last[axis] < most;
        }
        Some(Around { q, first, last, is_bounded })
    }

    /// Whether the level takes a box.
    #[inline(always)]
    pub fn takes(&self, q: &Quanta) -> bool {
        let (lengths, [low, high]) = (q.lengths(), &self.mins);
        // Without branches: lengths are as good as random.
        let excess = (0..4).fold(0, |excess, axis| {
            let is_long = i32::from(lengths[axis] > self.reach[axis]);
            let is_far = i32::from(q.min[axis] < low[axis]) | i32::from(q.min[axis] > high[axis]);
            excess | is_long | is_far
        });
        excess == 0 || self.takes_all
    }

    /// Whether a box overlaps no box of the level, since those all lie elsewhere: their mins by
    /// [`takes`](Self::takes), their maxes as far from these as they are long.
    #[inline(always)]
    pub fn is_beyond(&self, q: &Quanta) -> bool {
        let [low, high] = &self.mins;
        (0..3).any(|axis| {
            q.max[axis] < low[axis] || q.min[axis] > high[axis].saturating_add(self.reach[axis])
        })
    }

    /// The cell of a box that the level takes.
    #[inline(always)]
    pub fn home(&self, q: &Quanta) -> u32 {
        let [x, y, z] = std::array::from_fn(|axis| self.axes[axis].cell(q.min[axis]));
        self.cell_at(x, y, z)
    }

    #[inline(always)]
    pub fn cell_at(&self, x: u32, y: u32, z: u32) -> u32 {
        self.first_cell + (z * self.axes[1].count + y) * self.axes[0].count + x
    }
}

/// The levels for some boxes, finest first; the last one takes everything. The same ones regardless of the
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
            levels.extend(Level::of_far(&mut sample));
            for _ in 0..SPARE_MOST {
                edges = edges.map(|edge| edge * SPARE_GROWTH);
                if (0..3).all(|axis| edges[axis] >= sample.extent[axis]) {
                    break;
                }
                levels.push(Level::new(&sample, edges, edges, CELLS_LEAST));
            }
        }
        levels.push(Level::of_everything());
        let mut next = 0;
        for level in &mut levels {
            level.first_cell = next;
            next += level.cell_count();
        }
        levels
    })
}

/// The level of a class of boxes with the cells in which a search costs least.
fn level(sample: &Sample, density: &Density, class: &SizeClass, total: f32) -> Level {
    let limit = (class.share * total * CELLS_A_BOX).clamp(CELLS_LEAST, CELLS_MOST);
    let longest = class.least_edges.map(|edge| (edge * HULL_GROWTH).min(f32::MAX));
    let lengths = || (0..EDGES).map(|step| EDGE_LEAST * EDGE_GROWTH.powi(step));
    let mut best = (longest, f32::INFINITY);
    for length_x in lengths() {
        for length in lengths() {
            let [x, y, z] = longest;
            let edges = [x * length_x, y * length, z * length].map(|edge| edge.min(f32::MAX));
            let cost = search_cost(sample, density, class, edges, limit);
            if cost < best.1 {
                best = (edges, cost);
            }
        }
    }
    Level::new(sample, best.0, longest, limit).near(sample, best.0)
}

/// Cost of a search around a box of a class, in tests of a block.
fn search_cost(
    sample: &Sample,
    density: &Density,
    class: &SizeClass,
    edges: [f32; 3],
    limit: f32,
) -> f32 {
    let counts = cell_counts(sample, edges);
    let spans: [f32; 3] = std::array::from_fn(|a| {
        let reach = class.least_edges[a] * HULL_GROWTH + class.mean_edges[a];
        (1.0 + reach / edges[a]).min(counts[a])
    });
    let cells: f32 = spans.iter().product();
    // A table with more cells is folded: then each cell has boxes from several places.
    let folded = (counts.iter().product::<f32>() / limit).max(1.0);
    let boxes = class.share * density.in_cell(edges) * folded;
    // A block that is not full is tested as one that is.
    let blocks = boxes / SLOTS as f32 + 0.37 * (1.0 - (-boxes).exp());
    spans[1] * spans[2] * LINE_COST + cells * (CELL_COST + blocks)
}

const _: () = assert!(LONGEST as f32 >= (1 << super::axis::CELL_BITS) as f32 / EDGE_LEAST);
