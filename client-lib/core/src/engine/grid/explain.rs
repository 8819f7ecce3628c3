//! Where the grid puts two boxes, and whether it compares them: for `pairmaskd explain`.

use super::layout::Layout;
use crate::aabb::{Aabb, BoxClass};
use crate::floats;

/// Where a box stands in the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCell {
    /// Its level, 0 for the finest.
    pub level: u32,
    /// The cell of its min corner on each axis, before folding.
    pub first_cell: [i32; 3],
    /// The cell of its max corner.
    pub last_cell: [i32; 3],
    /// Edges of the level's cells, about.
    pub cell_edges: [f32; 3],
}

/// How the grid sees two boxes of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridView {
    /// Levels of the scene. The last one is a single cell for all that fits no other.
    pub levels: u32,
    /// The two boxes; `None` for one that overlaps nothing, which has no cell.
    pub homes: [Option<GridCell>; 2],
    /// Whether their cells are close enough for the two to be compared. Boxes that overlap always
    /// are; where an axis is folded, some boxes far apart are compared as well.
    pub neighbours: bool,
}

/// Where the engine puts boxes `a` and `b` of a scene, by the functions that it culls with.
///
/// # Panics
/// When `a` or `b` is no box of the scene.
pub fn explain(boxes: &[Aabb], a: usize, b: usize) -> GridView {
    floats::with_default(|| {
        let mut layout = Layout::default();
        layout.choose(boxes);
        let two = [boxes[a], boxes[b]];
        let homes = two.map(|one| cell_of(&layout, &one));
        let neighbours = match homes {
            [Some(p), Some(q)] => {
                // Pairs across levels are looked for in the finer one, from the larger box.
                let level = p.level.min(q.level);
                let [p, q] = two.map(|one| cells(&layout, level as usize, &one));
                let near = |axis: usize, p: &Cells, q: &Cells| {
                    (p.0[axis] - 1..=p.1[axis]).contains(&q.0[axis])
                };
                (0..3).all(|axis| near(axis, &p, &q) || near(axis, &q, &p))
            }
            _ => false,
        };
        GridView { levels: layout.levels.len() as u32, homes, neighbours }
    })
}

/// Cells of the min and the max corner.
type Cells = ([i32; 3], [i32; 3]);

fn cells(layout: &Layout, level: usize, one: &Aabb) -> Cells {
    let axes = &layout.levels[level].axes;
    let of = |corner: [f32; 3]| std::array::from_fn(|axis| axes[axis].cell(corner[axis]));
    (of(one.min), of(one.max))
}

fn cell_of(layout: &Layout, one: &Aabb) -> Option<GridCell> {
    if one.class() != BoxClass::Valid {
        return None;
    }
    let level = layout.levels.iter().position(|level| level.home(one.min, one.max).is_some())?;
    let (first_cell, last_cell) = cells(layout, level, one);
    let cell_edges = layout.levels[level].axes.map(|axis| axis.edge());
    Some(GridCell { level: level as u32, first_cell, last_cell, cell_edges })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_that_overlap_are_neighbours_in_every_level() {
        // Sizes over four decades, so that there are several levels.
        let boxes: Vec<Aabb> = (0..400u32)
            .map(|i| {
                let edge = [0.01, 0.1, 1.0, 30.0][(i % 4) as usize];
                let at = |k: u32| (i.wrapping_mul(k) % 101) as f32 * 0.3;
                let min = [at(7), at(31), at(57)];
                Aabb { min, max: min.map(|x| x + edge) }
            })
            .collect();
        let mut compared = 0;
        for a in 0..boxes.len() {
            for b in a + 1..boxes.len() {
                let view = explain(&boxes, a, b);
                assert!(view.neighbours || !boxes[a].overlaps(&boxes[b]), "({a}, {b}): {view:?}");
                compared += usize::from(view.neighbours);
            }
            if a > 20 {
                break;
            }
        }
        assert!(compared < 22 * 400, "not everything is a neighbour");
        let nothing = explain(&[Aabb::EMPTY, boxes[0]], 0, 1);
        assert_eq!((nothing.homes[0], nothing.neighbours), (None, false));
    }
}
