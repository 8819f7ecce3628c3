//! Which levels a scene gets, and how large their cells are: the papers' X, chosen from a sample.
//!
//! The model below knows what a row costs in strips ([`crate::engine::strips`]); it only steers.
//! Any layout gives the same pairs.
//!
//! An axis on which all boxes overlap one another, as the third of a game in a plane, is not treated by
//! itself. Where its mins are within an edge of the longest box it has one layer of cells, and the model
//! gives it no more where layers part nothing. Of 100,000 boxes with a pair each, a row is compared with 24
//! columns where z is [0, 1] or of random ends around 0, with 18 where those are from 0.05 to 55, and with
//! 33 in a cube. The compare of that axis is left in the kernels: without it they take a
//! tenth less time (AVX-512), a frame 4 % less, of which seeing that all pairs overlap takes a part.

use super::axis::{Axis, CELL_LIMIT};
use super::fold::folded;
use super::level::Level;
use super::sample::{Density, Sample, SampledBox};
use crate::aabb::Aabb;
use crate::floats;

/// Time of one strip, as a unit: the others are relative to it.
const STRIP_COST: f32 = 1.0;
/// Looking up the runs of a row in one finer level.
const LEVEL_COST: f32 = 4.0;
/// Looking up one line of cells there.
const LINE_COST: f32 = 0.7;
/// Looking up the runs of a cell that has boxes.
const CELL_COST: f32 = 4.0;
const EMPTY_CELL_COST: f32 = 0.25;
/// Columns that a strip beyond the first of a run takes.
const STRIP_COLUMNS: f32 = 16.0;

/// Cells are at least this much longer than the longest edge of their boxes, so that rounding
/// seldom sends a box of that length to a coarser level.
const CELL_MARGIN: f32 = 1.001;
/// Looking at all boxes of a level, for each of them: lines of some sixteen cells, of which there are two a box, and
/// full strips.
const WHOLE_COST: f32 = 2.0 / 16.0 * (LINE_COST + STRIP_COST);
/// Strips of a box from which it is one of the few large ones: an ordinary one takes 2 to 8.
const MANY_STRIPS: f32 = 64.0;
/// Most cells of all levels, for each box: 4 bytes a cell.
const CELLS_A_BOX: f32 = 2.0;
/// Cells that a level may have however few its boxes are.
const CELLS_LEAST: f32 = 512.0;
/// Most cells of a level: with ten levels their numbers stay below [`super::homes::CELL_MASK`].
const CELLS_MOST: f32 = 33_554_432.0;
/// A cell that holds so many times as many boxes as the density says, and so many more, shows that the density is that of
/// a larger place, in which boxes lie on lines or planes. Each look takes as long as the density.
const FAR_MORE: f32 = 4.0;
const FEW_BOXES: f32 = 16.0;
const CHECKS: usize = 3;
/// Each spare level's cells against those of the level before.
const SPARE_GROWTH: f32 = 4.0;
/// Most spare levels: 4^8 = 65,536 times the size of the largest box that the sample saw.
const SPARE_MOST: usize = 8;

/// Shares of the sample, by size, at which a level may end.
const BORDERS: [f32; 5] = [0.5, 0.8, 0.9, 0.95, 0.98];
/// Stretches of the sample between these.
const SPANS: usize = BORDERS.len() + 1;

/// The levels of a frame. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct Layout {
    /// Finest first. The last one takes everything.
    pub levels: Vec<Level>,
    pub cell_count: u32,
    /// What a box takes by the model, in strips: 2 to 8 where cells part the boxes, 30 and far more where they do
    /// not.
    pub cost: f32,
    /// Sizes of boxes, smallest first, each with a level.
    classes: [Option<SizeClass>; 3],
    sample: Sample,
}

/// The sizes of a sampled scene, smallest first, as the levels of the grid part them.
pub(crate) fn size_classes(
    sample: &Sample,
    density: &Density,
) -> impl Iterator<Item = SizeClass> + use<> {
    best_groups(sample, density).into_iter().flatten()
}

/// Boxes of about one size, as one level: what the model needs of them.
#[derive(Clone, Copy)]
pub(crate) struct SizeClass {
    pub share: f32,
    /// How many there are, about.
    boxes: f32,
    /// Their mean edge on each axis.
    pub mean_edges: [f32; 3],
    /// Slightly more than their longest edge on each axis, the shortest edges of cells for them; above 0.
    pub least_edges: [f32; 3],
    cell_edges: [f32; 3],
    /// Boxes of the class in the home cell of a box.
    occupancy: f32,
    /// Cost a box of the class, in its own level.
    own_cost: f32,
}

impl Layout {
    /// Chooses the levels for a scene: the same ones regardless of the flags of this thread.
    pub fn choose(&mut self, boxes: &[Aabb]) {
        floats::with_default(|| self.choose_levels(boxes));
    }

    fn choose_levels(&mut self, boxes: &[Aabb]) {
        self.levels.clear();
        (self.cell_count, self.cost, self.classes) = (0, 0.0, [None; 3]);
        self.sample.take(boxes);
        let m = self.sample.boxes.len();
        if m > 0 {
            let groups = groups(&mut self.sample);
            (self.cost, self.classes) = (total_cost(groups), groups);
            for group in groups.into_iter().flatten() {
                let boxes = group.share * m as f32 * self.sample.weight;
                let axes = axes(&self.sample, group.cell_edges, boxes);
                self.append(axes);
            }
            // Before spare levels, which are many.
            let far = far_axes(&mut self.sample);
            let spares_after = self.levels.last().map_or([1.0; 3], |l| l.axes.map(|a| a.edge()));
            if let Some(axes) = far {
                self.append(axes);
            }
            self.append_spares(spares_after);
        }
        self.append(Level::EVERYTHING.axes);
        // Coarse levels come first in the order of positions, because their boxes are the rows of
        // pairs across levels.
        for level in self.levels.iter_mut().rev() {
            level.first_cell = self.cell_count;
            self.cell_count += level.cell_count();
        }
    }

    /// As [`cost`](Self::cost), where it does not hang on a few large boxes of the sample: one in a thousand sampled boxes
    /// may be the only one of a million. Boxes that look at many others count as far as they are sure to be as many: by
    /// two standard deviations less than in the sample.
    pub fn sure_cost(&self) -> f32 {
        let m = self.sample.boxes.len() as f32;
        let mut rest = self.sample.boxes.as_slice();
        let (mut sum, mut large_sum, mut large_count) = (0.0, 0.0, 0.0f32);
        for (number, class) in self.classes.iter().flatten().enumerate() {
            let count = (class.share * m).round() as usize;
            let (these, larger) = rest.split_at(count.min(rest.len()));
            rest = larger;
            sum += these.len() as f32 * class.own_cost;
            for b in these {
                let finer = self.classes[..number].iter().flatten();
                let across: f32 = finer.map(|fine| look_cost(&b.edges, fine)).sum();
                if across > MANY_STRIPS {
                    (large_sum, large_count) = (large_sum + across, large_count + 1.0);
                } else {
                    sum += across;
                }
            }
        }
        let sure = (1.0 - 2.0 / large_count.max(1.0).sqrt()).max(0.0);
        (sum + sure * large_sum) / m.max(1.0)
    }

    fn append(&mut self, axes: [Axis; 3]) {
        self.levels.push(Level { axes, first_cell: 0 });
    }

    /// Coarser levels for the few boxes that are larger than any that the sample saw.
    fn append_spares(&mut self, mut edges: [f32; 3]) {
        for _ in 0..SPARE_MOST {
            edges = edges.map(|e| e * SPARE_GROWTH);
            if (0..3).all(|axis| edges[axis] >= self.sample.extent[axis]) {
                return;
            }
            let spare = axes(&self.sample, edges, 0.0);
            self.append(spare);
        }
    }
}

/// The levels of a sample, finest first: by its density, and where their cells hold far more boxes than that says, by
/// what these hold.
fn groups(sample: &mut Sample) -> [Option<SizeClass>; 3] {
    let density = sample.density();
    let mut groups = best_groups(sample, &density);
    for _ in 0..CHECKS {
        let Some(class) = groups[0] else { break };
        let seen = sample.density_in(class.cell_edges);
        let occupancy = class.share * seen.in_cell(class.cell_edges);
        if occupancy < FAR_MORE * class.occupancy + FEW_BOXES {
            break;
        }
        groups = best_groups(sample, &seen);
    }
    groups
}

/// The cheapest way to share the sample among one to three levels, finest first.
fn best_groups(sample: &Sample, density: &Density) -> [Option<SizeClass>; 3] {
    let m = sample.boxes.len();
    if sample.alike {
        return [Some(group(sample, density, &EdgeStats::of(&sample.boxes))), None, None];
    }
    let mut borders = [0; SPANS + 1];
    for (border, share) in borders[1..].iter_mut().zip(BORDERS) {
        *border = (share * m as f32) as usize;
    }
    borders[SPANS] = m;
    let spans: [EdgeStats; SPANS] =
        std::array::from_fn(|i| EdgeStats::of(&sample.boxes[borders[i]..borders[i + 1]]));
    let mut memo = [[None; SPANS + 1]; SPANS + 1];
    let mut between = |a: usize, b: usize| -> Option<SizeClass> {
        (borders[a] < borders[b]).then(|| {
            *memo[a][b].get_or_insert_with(|| {
                let edges = spans[a..b].iter().fold(EdgeStats::default(), EdgeStats::join);
                group(sample, density, &edges)
            })
        })
    };
    let last = SPANS;
    let mut best = [between(0, last), None, None];
    let mut best_cost = total_cost(best);
    for first in 1..last {
        for second in first + 1..=last {
            let third = if second == last { None } else { between(second, last) };
            let groups = [between(0, first), between(first, second), third];
            let cost = total_cost(groups);
            if cost < best_cost {
                (best, best_cost) = (groups, cost);
            }
        }
    }
    best
}

/// Cost a box of a set of levels.
fn total_cost(groups: [Option<SizeClass>; 3]) -> f32 {
    let mut cost = 0.0;
    for (i, coarse) in groups.iter().enumerate() {
        let Some(coarse) = coarse else { continue };
        let across: f32 = groups[..i].iter().flatten().map(|fine| cross_cost(coarse, fine)).sum();
        cost += coarse.share * (coarse.own_cost + across);
    }
    cost
}

/// Edges of some boxes of the sample.
#[derive(Clone, Copy, Default)]
struct EdgeStats {
    box_count: usize,
    sum: [f64; 3],
    largest: [f32; 3],
}

impl EdgeStats {
    fn of(boxes: &[SampledBox]) -> Self {
        let mut stats = Self { box_count: boxes.len(), ..Self::default() };
        for b in boxes {
            for axis in 0..3 {
                let edge = b.edges[axis];
                stats.sum[axis] += f64::from(edge);
                stats.largest[axis] = stats.largest[axis].max(edge);
            }
        }
        stats
    }

    fn join(self, other: &Self) -> Self {
        Self {
            box_count: self.box_count + other.box_count,
            sum: std::array::from_fn(|axis| self.sum[axis] + other.sum[axis]),
            largest: std::array::from_fn(|axis| self.largest[axis].max(other.largest[axis])),
        }
    }
}

/// Boxes of the sample with these edges as a level with the cheapest cells.
fn group(sample: &Sample, density: &Density, edges: &EdgeStats) -> SizeClass {
    let share = edges.box_count as f32 / sample.boxes.len() as f32;
    let mean_edges = edges.sum.map(|sum| (sum / edges.box_count as f64) as f32);
    let mut least_edges = edges.largest.map(|edge| edge * CELL_MARGIN);
    for axis in 0..3 {
        if least_edges[axis] < f32::MIN_POSITIVE {
            // Flat boxes: any cell holds them, so start from what the scene has room for.
            least_edges[axis] = (sample.extent[axis] / 4096.0).max(f32::MIN_POSITIVE);
        }
    }
    let boxes = share * sample.weight * sample.boxes.len() as f32;
    let model = GroupModel { sample, density, share, mean_edges, least_edges, boxes };
    let (mut best, _) = model.best_of_growth(1.0);
    let mut best_growth = 1.0f32;
    let mut growth = 1.0f32;
    // Doubled cells until they are crowded, or one for all: larger ones are no better.
    loop {
        growth *= 2.0;
        let (candidate, last) = model.best_of_growth(growth);
        if candidate.own_cost < best.own_cost {
            (best, best_growth) = (candidate, growth);
        }
        if last || growth > 1e6 {
            break;
        }
    }
    for step in [std::f32::consts::SQRT_2, std::f32::consts::FRAC_1_SQRT_2] {
        let (candidate, _) = model.best_of_growth((best_growth * step).max(1.0));
        if candidate.own_cost < best.own_cost {
            best = candidate;
        }
    }
    best
}

/// What the cost of a group is computed from.
struct GroupModel<'a> {
    sample: &'a Sample,
    density: &'a Density,
    share: f32,
    mean_edges: [f32; 3],
    least_edges: [f32; 3],
    boxes: f32,
}

impl GroupModel<'_> {
    /// The cheapest of cells that are `growth` times as long as the longest box and as narrow or
    /// narrower along x; and whether all of them are crowded, or hold everything.
    fn best_of_growth(&self, growth: f32) -> (SizeClass, bool) {
        let [least_x, least_y, least_z] = self.least_edges;
        let mut best: Option<SizeClass> = None;
        let mut last = true;
        for narrowing in [1.0, 0.5, 0.25] {
            let cell_edges =
                [least_x * (growth * narrowing).max(1.0), least_y * growth, least_z * growth];
            let candidate = self.group(cell_edges);
            let whole = (0..3).all(|axis| cell_edges[axis] >= self.sample.extent[axis]);
            last &= whole || (candidate.occupancy > 4.0 * STRIP_COLUMNS);
            if best.is_none_or(|best| candidate.own_cost < best.own_cost) {
                best = Some(candidate);
            }
            if growth * narrowing <= 1.0 {
                // The boxes are too long for narrower cells.
                break;
            }
        }
        (best.unwrap_or_else(|| self.group(self.least_edges)), last)
    }

    fn group(&self, cell_edges: [f32; 3]) -> SizeClass {
        let Self { share, mean_edges, least_edges, .. } = *self;
        // Where boxes are in few places, the density there says too much of long cells.
        let occupancy = (share * self.density.in_cell(cell_edges)).min(self.boxes);
        let (own_cost, boxes) = (self.own_cost(cell_edges, occupancy), self.boxes);
        SizeClass { share, boxes, mean_edges, least_edges, cell_edges, occupancy, own_cost }
    }

    /// Cost of a box in its own level.
    fn own_cost(&self, cell_edges: [f32; 3], occupancy: f32) -> f32 {
        let extent = &self.sample.extent;
        let cells_per_unit = cell_edges.map(|edge| 1.0 / edge);
        // Probability that a box reaches into the next cell.
        let [x, y, z] = std::array::from_fn(|axis| {
            let whole = cell_edges[axis] > extent[axis];
            if whole { 0.0 } else { (self.mean_edges[axis] * cells_per_unit[axis]).min(1.0) }
        });
        let own_run = strips(occupancy * (0.5 + x));
        let other_run = strips(occupancy * (2.0 + x));
        let other_lines = y + z * (2.0 + y);
        let cells: f32 =
            (0..3).map(|axis| (extent[axis] * cells_per_unit[axis]).max(1.0)).product();
        STRIP_COST * (own_run + other_lines * other_run)
            + CELL_COST / (1.0 + occupancy)
            + EMPTY_CELL_COST * (cells / self.boxes).min(CELLS_A_BOX)
    }
}

/// Strips of a run of `columns` on average: one if there is anything, more if it is long.
fn strips(columns: f32) -> f32 {
    columns / (0.7 + columns) + columns / STRIP_COLUMNS
}

/// Cost of a box of `coarse` in the level of `fine`.
fn cross_cost(coarse: &SizeClass, fine: &SizeClass) -> f32 {
    look_cost(&coarse.mean_edges, fine)
}

/// Cost of a box of these edges in the level of `fine`: at most that of all its cells.
fn look_cost(edges: &[f32; 3], fine: &SizeClass) -> f32 {
    let cells = |axis: usize| 2.0 + edges[axis] / fine.cell_edges[axis];
    let lines = cells(1) * cells(2);
    let looks = lines * (LINE_COST + STRIP_COST * strips(fine.occupancy * cells(0)));
    let all = fine.boxes * WHOLE_COST;
    LEVEL_COST + looks.min(all)
}

/// Cells of some edges that the sampled boxes span on each axis.
pub(crate) fn cell_counts(sample: &Sample, edges: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| {
        (sample.extent[axis] / edges[axis]).floor().clamp(0.0, CELL_LIMIT - 1.0) + 1.0
    })
}

/// Axes of a level of cells of `edges` over the sample's bounds, for about `boxes` boxes.
fn axes(sample: &Sample, edges: [f32; 3], boxes: f32) -> [Axis; 3] {
    let limit = (boxes * CELLS_A_BOX).clamp(CELLS_LEAST, CELLS_MOST);
    // So that no near box is beyond the last number of a cell.
    let edges = sample.edges_for(edges, CELL_LIMIT);
    let counts = cell_counts(sample, edges);
    if counts.iter().product::<f32>() <= limit && !sample.has_far {
        return std::array::from_fn(|axis| {
            Axis::clamped(sample.low[axis], edges[axis], counts[axis] as u32)
        });
    }
    // Too wide for a table, or boxes lie where it ends, which would crowd its last cells.
    // A spare level has none of the sampled boxes.
    let mins = sample.near_mins().take(if boxes > 0.0 { usize::MAX } else { 0 });
    let (counts, middle) = (folded(mins, edges, counts, limit), sample.middle());
    std::array::from_fn(|axis| {
        // Folded, or into a cell of its own, what lies far away would crowd the others. Spare levels take the few of
        // it that are too long for its level.
        let near = if boxes > 0.0 { sample.near_on(axis, edges[axis]) } else { None };
        match (counts[axis], near) {
            (1, None) => Axis::WHOLE,
            (1, Some(near)) => Axis::whole_of(near),
            (count, None) => Axis::wrapped(middle[axis], edges[axis], count),
            (count, Some(near)) => Axis::wrapped(middle[axis], edges[axis], count).only(near),
        }
    })
}

/// Axes of a level for boxes that lie far from all others, where the sample has some.
fn far_axes(sample: &mut Sample) -> Option<[Axis; 3]> {
    let far = sample.far()?;
    let limit = (CELLS_A_BOX * far.count).clamp(CELLS_LEAST, CELLS_MOST);
    let (edges, counts) = far.cells(CELL_MARGIN, limit);
    Some(std::array::from_fn(|axis| Axis::wrapped(far.middle[axis], edges[axis], counts[axis])))
}
