//! Which lines of cells a box looks at.
//!
//! Within a level each pair of neighbouring lines is looked at from the lower one only: of the 27
//! cells around a cell, 14 with itself, in 5 runs. A box at the lower line that does not reach into
//! the next cell on an axis overlaps nothing there, so most boxes look at one or two runs.

use std::ops::Range;

use super::axis::Axis;
use super::level::{Level, Reach};

/// Bits of [`Reach`].
pub(super) const REACH_X: Reach = 1;
pub(super) const REACH_Y: Reach = 2;
pub(super) const REACH_Z: Reach = 4;

/// A neighbouring line of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Line {
    pub first_cell: u32,
    /// What a box of the lower line must reach to overlap a box there.
    pub needs: Reach,
}

/// The later neighbours of a line, by rising first cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LaterLines {
    lines: [Line; 8],
    count: usize,
}

impl LaterLines {
    /// Of line (y, z) of a level.
    ///
    /// A neighbour at +1 (folded or not) is one cell further up, so the box itself must reach it;
    /// at −1 the other box must reach down, which only the test can decide. On a folded axis of four
    /// cells or more the two are different lines, so that no pair is looked at twice.
    pub fn of(level: &Level, y: u32, z: u32) -> Self {
        let mut found = Self::default();
        let line = z * level.axes[1].cell_count + y;
        for dz in [-1, 0, 1] {
            for dy in [-1, 0, 1] {
                let y = neighbour(&level.axes[1], y, dy);
                let z = neighbour(&level.axes[2], z, dz);
                let (Some(y), Some(z)) = (y, z) else { continue };
                if z * level.axes[1].cell_count + y > line {
                    let needs =
                        if dy == 1 { REACH_Y } else { 0 } | if dz == 1 { REACH_Z } else { 0 };
                    found.lines[found.count] = Line { first_cell: level.cell_at([0, y, z]), needs };
                    found.count += 1;
                }
            }
        }
        found.lines[..found.count].sort_unstable_by_key(|line| line.first_cell);
        found
    }

    pub fn as_slice(&self) -> &[Line] {
        &self.lines[..self.count]
    }
}

/// The cell `step` further on an axis, if there is one.
fn neighbour(axis: &Axis, cell: u32, step: i32) -> Option<u32> {
    let next = i64::from(cell) + i64::from(step);
    match u32::try_from(next) {
        Ok(next) if next < axis.cell_count => Some(next),
        _ if axis.wraps => Some(axis.fold(next as i32)),
        _ => None,
    }
}

/// Folded cells `low..=high` of an axis, as two ranges of rising cells; the second may be empty.
pub(super) fn folded(axis: &Axis, low: i32, high: i32) -> [Range<u32>; 2] {
    let count = axis.cell_count;
    if !axis.wraps && count > 1 {
        // Clamped cells lie in the table but for the one below the first.
        return [low.max(0) as u32..(high + 1).clamp(0, count as i32) as u32, 0..0];
    }
    if high - low + 1 >= count as i32 {
        return [0..count, 0..0];
    }
    let (first, last) = (axis.fold(low), axis.fold(high));
    if first <= last { [first..last + 1, 0..0] } else { [0..last + 1, first..count] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn levels() -> Vec<Level> {
        let mut axes = vec![Axis::WHOLE];
        axes.extend([1, 2, 3, 5].map(|count| Axis::clamped(0.0, 1.0, count)));
        axes.extend([4, 8].map(|count| Axis::wrapped(0.0, 1.0, count)));
        let mut levels = Vec::new();
        for y in &axes {
            for z in &axes {
                levels.push(Level { axes: [Axis::WHOLE, *y, *z], first_cell: 7 });
            }
        }
        levels
    }

    #[test]
    fn each_two_neighbouring_lines_meet_once() {
        for level in levels() {
            let [_, y_axis, z_axis] = &level.axes;
            let mut met = HashSet::new();
            for z in 0..z_axis.cell_count {
                for y in 0..y_axis.cell_count {
                    let later = LaterLines::of(&level, y, z);
                    let here = level.cell_at([0, y, z]);
                    assert!(later.as_slice().windows(2).all(|w| w[0].first_cell < w[1].first_cell));
                    for line in later.as_slice() {
                        assert!(line.first_cell > here);
                        assert!(met.insert((here, line.first_cell)), "{level:?}");
                    }
                }
            }
            for z in 0..z_axis.cell_count {
                for y in 0..y_axis.cell_count {
                    for (dy, dz) in [(-1, -1), (0, -1), (1, -1), (-1, 0)] {
                        let (Some(ny), Some(nz)) =
                            (neighbour(y_axis, y, dy), neighbour(z_axis, z, dz))
                        else {
                            continue;
                        };
                        let (a, b) = (level.cell_at([0, y, z]), level.cell_at([0, ny, nz]));
                        assert!(a == b || met.contains(&(a.min(b), a.max(b))), "{level:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn folded_ranges_rise_and_hold_each_cell_once() {
        let axis = Axis::wrapped(0.0, 1.0, 8);
        for low in -20..20 {
            for len in 1..12 {
                let [a, b] = folded(&axis, low, low + len - 1);
                let cells: Vec<u32> = a.chain(b).collect();
                assert!(cells.is_sorted_by(|a, b| a < b));
                let expected: HashSet<u32> = (low..low + len).map(|c| axis.fold(c)).collect();
                assert_eq!(cells.iter().copied().collect::<HashSet<_>>(), expected);
            }
        }
        let axis = Axis::clamped(0.0, 1.0, 5);
        assert_eq!(folded(&axis, -1, 1), [0..2, 0..0]);
        assert_eq!(folded(&axis, 3, 4), [3..5, 0..0]);
    }
}
