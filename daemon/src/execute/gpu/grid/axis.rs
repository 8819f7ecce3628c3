//! The axes of a level, and the proof of the way from a coordinate to a cell number, which
//! `shared/grid_layout.wgsl` has for the device and [`grid_layout`](pairmask_shaders::mirror::grid_layout) for the
//! CPU.
//!
//! # Why no pair is lost to rounding
//!
//! All that the grid relies on is that the cell function is **monotone**: a ≤ b implies
//! cell(a) ≤ cell(b), in the f32 arithmetic that computes it. It is a chain of monotone steps:
//! numbers below 2^−60 become 0 and those beyond ±2^60 are held there, both by their bits; a
//! constant is subtracted, the difference multiplied with a positive constant (IEEE rounding is
//! monotone), held between two constants, and 1.5 · 2^23 added, which rounds to an integer. What
//! WGSL does not promise (subnormals, infinities, NaN) is out of the way after the first step, so
//! every driver computes the same cells; and were one to round differently, the order of the
//! reply would differ and not its pairs. For that, one device must round in one way: cells are
//! computed on it alone, once for homes and again for rows, and never on the host. Devices that share a
//! frame or a scene must be alike for it ([`compute_alike`](super::super::compute_alike)),
//! since each looks for the pairs of cells that are its. A software adapter's
//! threads inherit the flags of the thread that opens the device, which are the default ones
//! ([`Gpu::open`](super::super::Gpu::open)). Origins and scales are numbers that the host writes into the
//! layout, regardless of what they are.
//!
//! From there on it is the proof of the CPU's grid (`engine/grid/axis` of `pairmask-core`): where a box b is in a level,
//!
//! > cell(a.min) − 1 ≤ cell(b.min) ≤ cell(a.max)
//!
//! for any a that overlaps b. How large a cell is in space does not enter, nor where the sample saw
//! boxes. Folding keeps equal cells equal; a folded axis has at least four cells, so that the three
//! around a box are different ones and no pair is looked at twice.

use pairmask_core::engine::grid::FOLDED_LEAST;
use pairmask_shaders::layouts::GridLevel;
use pairmask_shaders::mirror::grid_layout::{TINY_BITS, plain};

/// Largest magnitude of a cell number; what lies beyond shares the outermost cell.
pub(super) const CELL_LIMIT: f32 = 2_097_152.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    pub origin: f32,
    pub scale: f32,
    pub low: f32,
    pub high: f32,
    pub fold: i32,
    pub count: u32,
    pub wraps: bool,
}

impl Axis {
    /// `count` cells of edge `edge` from `start` on; what lies outside is in the first or the last.
    pub fn clamped(start: f32, edge: f32, count: u32) -> Self {
        let (origin, scale) = Self::steps(start, edge);
        Self { origin, scale, low: 0.0, high: count as f32 - 1.0, fold: -1, count, wraps: false }
    }

    /// Cells of edge `edge` around `middle`, folded into `count` of them, a power of two of at
    /// least [`FOLDED_LEAST`]. Clusters far apart then share a table of moderate size, at the price
    /// of tests that find nothing.
    pub fn folded(middle: f32, edge: f32, count: u32) -> Self {
        debug_assert!(count.is_power_of_two() && count >= FOLDED_LEAST);
        let (origin, scale) = Self::steps(middle, edge);
        let fold = count as i32 - 1;
        Self { origin, scale, low: -CELL_LIMIT, high: CELL_LIMIT, fold, count, wraps: true }
    }

    /// Origin and scale. Rounding to the nearest puts borders at half cells; shifted, one is at
    /// `start`.
    fn steps(start: f32, edge: f32) -> (f32, f32) {
        let least = f32::from_bits(TINY_BITS);
        let edge = if edge.is_nan() { 1.0 } else { edge.clamp(least, 1.0 / least) };
        (plain(start + 0.5 * edge), 1.0 / edge)
    }
}

pub(super) fn level([x, y, z]: [Axis; 3], first_cell: u32) -> GridLevel {
    let of = |get: fn(&Axis) -> f32| [&x, &y, &z].map(get);
    GridLevel {
        origin: of(|a| a.origin),
        first_cell,
        scale: of(|a| a.scale),
        cell_count: x.count * y.count * z.count,
        low: of(|a| a.low),
        high: of(|a| a.high),
        fold: [x.fold, y.fold, z.fold],
        count: [x.count, y.count, z.count],
        wraps: u32::from(x.wraps) | u32::from(y.wraps) << 1 | u32::from(z.wraps) << 2,
        ..GridLevel::default()
    }
}

#[cfg(test)]
mod tests {
    use pairmask_shaders::mirror::grid_layout::cell;
    use pairmask_tests::stress_scenes::Rng;

    use super::*;

    fn levels() -> Vec<GridLevel> {
        let mut levels = Vec::new();
        for start in [0.0, -1.0e6, 3.0e38, f32::MIN, f32::INFINITY, 1e-40, f32::NAN] {
            for edge in [0.0, 1e-45, 1e-3, 1.0, 1.0e30, f32::MAX, f32::INFINITY, f32::NAN] {
                let [a, b] = [Axis::clamped(start, edge, 17), Axis::folded(start, edge, 16)];
                levels.push(level([a, b, Axis::clamped(start, edge, 1)], 0));
            }
        }
        levels
    }

    fn check(level: &GridLevel, a: f32, b: f32) {
        for axis in 0..3 {
            let (low, high) = (cell(level, axis, a.min(b)), cell(level, axis, a.max(b)));
            assert!(low <= high, "{level:?}: {a} and {b} are in cells {low} and {high}");
            for cell in [low, high] {
                assert!(((cell & level.fold[axis]) as u32) < level.count[axis]);
            }
        }
    }

    #[test]
    fn cells_rise_with_coordinates() {
        let mut rng = Rng::new(5);
        for level in levels() {
            for x in [f32::NEG_INFINITY, f32::MIN, -1.0, -1e-45, 0.0, 1e-45, 1.0, f32::MAX] {
                check(&level, x, x.next_up());
                check(&level, x, f32::INFINITY);
            }
            for _ in 0..500 {
                let [a, b] = [(); 2].map(|()| f32::from_bits(rng.bits() as u32));
                if !a.is_nan() && !b.is_nan() {
                    check(&level, a, b);
                    check(&level, a, a.next_up());
                }
            }
        }
    }

    #[test]
    fn plain_numbers_are_in_the_cell_one_expects() {
        let level = level(
            [Axis::clamped(10.0, 2.0, 8), Axis::folded(10.0, 2.0, 4), Axis::clamped(0.0, 1.0, 1)],
            0,
        );
        for (x, expected) in [(9.0, 0), (10.1, 0), (11.9, 0), (12.1, 1), (25.9, 7), (99.0, 7)] {
            assert_eq!(cell(&level, 0, x), expected, "{x}");
        }
        for (x, expected) in [(9.0, 3), (10.1, 0), (17.9, 3), (18.1, 0), (25.9, 3)] {
            assert_eq!(cell(&level, 1, x) & level.fold[1], expected, "{x}");
        }
        assert_eq!((plain(1e-30), plain(-0.0), plain(f32::INFINITY)), (0.0, 0.0, 1.152_921_5e18));
    }
}
