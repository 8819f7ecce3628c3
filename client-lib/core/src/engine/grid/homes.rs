//! Home cells: the level, cell and reach of each box of a tile.

// `&` instead of `&&`: a branch would keep the loop from being compiled to SIMD.
#![allow(clippy::needless_bitwise_bool)]

use super::level::Level;
use crate::aabb::{Aabb, KeyBox, coordinate};
use crate::engine::ingest;
use crate::engine::{AvailableIsa, Census};
use crate::simd::per_isa;

/// Low bits of a home: the cell in the table of all levels. The reach is in the three bits above.
pub(super) const CELL_MASK: u32 = (1 << REACH_SHIFT) - 1;
/// See [`CELL_MASK`].
pub(super) const REACH_SHIFT: u32 = 29;

/// Boxes looked at together: their keys, 6 KiB, stay in the first-level cache.
const BLOCK: usize = 256;

/// No home yet.
const HOMELESS: u32 = u32::MAX;

/// Up to this many boxes of a block are taken one by one to the coarser levels.
const FEW: usize = 16;

/// Keys of a block in wire order.
type BlockKeys = [[i32; BLOCK]; 6];

/// Writes the home of each box; what overlaps nothing has the cell `nothing`.
pub(super) fn find(
    boxes: &[Aabb],
    first_index: u32,
    levels: &[Level],
    nothing: u32,
    homes: &mut [u32],
    isa: AvailableIsa,
) -> Census {
    let mut census = Census::default();
    let mut keys: BlockKeys = [[0; BLOCK]; 6];
    let blocks = boxes.chunks(BLOCK).zip(homes.chunks_mut(BLOCK));
    for ((boxes, homes), first) in blocks.zip((first_index..).step_by(BLOCK)) {
        let mut columns = keys.each_mut().map(|k| &mut k[..boxes.len()]);
        let mut found = Census::default();
        ingest::fill(boxes, &mut columns, &mut found, isa);
        census = census.then(&found.behind(first));

        let valid = keys[0].map(|min_x| min_x != KeyBox::NOTHING.min[0]);
        let mut block_homes = valid.map(|valid| if valid { HOMELESS } else { nothing });
        let mut homeless = found.valid_of(boxes.len());
        for level in levels {
            if homeless <= FEW {
                break;
            }
            settle(level, &keys, &mut block_homes, isa);
            homeless = block_homes[..boxes.len()].iter().filter(|h| **h == HOMELESS).count();
        }
        if homeless > 0 {
            for (i, home) in block_homes[..boxes.len()].iter_mut().enumerate() {
                if *home == HOMELESS {
                    *home = home_of(&keys, i, levels);
                }
            }
        }
        homes.copy_from_slice(&block_homes[..boxes.len()]);
    }
    census
}

/// The first level that takes a box; the last one takes all.
fn home_of(keys: &BlockKeys, i: usize, levels: &[Level]) -> u32 {
    let coordinate = |component: usize| coordinate(keys[component][i]);
    let min = std::array::from_fn(coordinate);
    let max = std::array::from_fn(|axis| coordinate(3 + axis));
    let found = levels.iter().find_map(|level| level.home(min, max));
    let (cell, reach) = found.unwrap_or((levels[levels.len() - 1].first_cell, 0));
    cell | u32::from(reach) << REACH_SHIFT
}

per_isa! {
    /// Gives a home to every box that has none and that the level takes.
    fn settle<simd: S>(level: &Level, keys: &BlockKeys, homes: &mut [u32; BLOCK]) {
        let (_, level) = (simd, *level);
        for i in 0..BLOCK {
            let min = [coordinate(keys[0][i]), coordinate(keys[1][i]), coordinate(keys[2][i])];
            let max = [coordinate(keys[3][i]), coordinate(keys[4][i]), coordinate(keys[5][i])];
            let (cell, reach, fits) = level.cell_of(min, max);
            let home = cell | u32::from(reach) << REACH_SHIFT;
            homes[i] = if fits & (homes[i] == HOMELESS) { home } else { homes[i] };
        }
    }
}
