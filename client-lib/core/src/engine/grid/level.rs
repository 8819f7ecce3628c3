//! Levels: grids of growing cells, one behind the other in one table of cells.

use super::axis::Axis;

#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// The cells of x, y and z.
    pub axes: [Axis; 3],
    /// Number of its first cell in the table of all levels.
    pub first_cell: u32,
}

/// Whether a box reaches beyond its home cell: bit 0 for x, bit 1 for y, bit 2 for z.
pub(super) type Reach = u8;

impl Level {
    /// A level of one cell for all that no other level takes. Every box spans one cell there.
    pub const EVERYTHING: Self = Self { axes: [Axis::WHOLE; 3], first_cell: 0 };

    pub fn cell_count(&self) -> u32 {
        self.axes.iter().map(|a| a.cell_count).product()
    }

    /// The home cell (in the table) and reach of a box, or `None` where it spans more than two
    /// cells on some axis, or lies beyond them, so that it is not of this level.
    pub fn home(&self, min: [f32; 3], max: [f32; 3]) -> Option<(u32, Reach)> {
        let (cell, reach, fits) = self.cell_of(min, max);
        fits.then_some((cell, reach))
    }

    /// [`Self::home`] without a branch: cell, reach, and whether the box is of this level.
    #[inline(always)]
    pub fn cell_of(&self, min: [f32; 3], max: [f32; 3]) -> (u32, Reach, bool) {
        let mut cells = [0; 3];
        let mut reach = 0;
        let mut fits = true;
        for axis in 0..3 {
            let (low, high) = (self.axes[axis].cell(min[axis]), self.axes[axis].cell(max[axis]));
            fits &= self.axes[axis].takes(low, high);
            reach |= ((high != low) as u8) << axis;
            cells[axis] = self.axes[axis].fold(low);
        }
        (self.cell_at(cells), reach, fits)
    }

    /// The cell of the table at folded cell numbers.
    #[inline(always)]
    pub fn cell_at(&self, [x, y, z]: [u32; 3]) -> u32 {
        let line = z * self.axes[1].cell_count + y;
        self.first_cell + line * self.axes[0].cell_count + x
    }
}
