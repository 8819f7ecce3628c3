//! How a scene too wide for a table of cells is folded into one: over which axes, and how often.
//!
//! Cells that a multiple of the table's edge apart coincide. Folded evenly, a table is crowded by rows of
//! boxes in far places: all of them stand in the few cells of one line. So cells go from axis to axis, until no
//! more of the sampled boxes come to share a cell only since it was folded.

/// Fewest cells of a folded axis: with fewer, a cell would be its own neighbour on both sides.
pub const FOLDED_LEAST: u32 = 4;
/// Slots that cells of sampled boxes are counted in: two of 1,024 boxes share one by chance 32 times, however the
/// table is folded.
const SLOTS_BITS: u32 = 14;
/// Pairs of sampled boxes in a cell, for each 32, that are as few as chance makes them.
const FEW_PAIRS_BOXES: u64 = 32;
/// Share of the pairs that must go with a move of cells, one in so many: each takes as long as to sort a thousand boxes.
const GAIN: u64 = 8;

/// Cells of each axis, powers of two and about `limit` in all, for boxes with these min corners and cells of these
/// edges, of which `counts` lie side by side. One where an axis is not parted.
pub fn folded(
    mins: impl Iterator<Item = [f32; 3]>,
    edges: [f32; 3],
    counts: [f32; 3],
    limit: f32,
) -> [u32; 3] {
    let per_unit = edges.map(|edge| 1.0 / edge);
    // Beyond the numbers of an i64 a cell has the last one.
    let cell_of = |min: [f32; 3]| [0, 1, 2].map(|axis| (min[axis] * per_unit[axis]) as i64 as u64);
    let cells: Vec<[u64; 3]> = mins.map(cell_of).collect();
    // A level without sampled boxes, a spare one, takes no memory.
    let slots = if cells.is_empty() { 0 } else { 1 << SLOTS_BITS };
    let mut crowd = Crowd { cells, slots: vec![[0; 2]; slots], round: 0 };

    let most = counts.map(|count| (count as u64).next_power_of_two().trailing_zeros());
    let limit = limit.max(1.0).log2() as u32;
    let mut bits = most;
    while bits.iter().sum::<u32>() > limit {
        let widest = (0..3).fold(0, |a, b| if bits[b] > bits[a] { b } else { a });
        bits[widest] -= 1;
    }
    let apart = crowd.pairs(most);
    let few = apart + crowd.cells.len() as u64 / FEW_PAIRS_BOXES;
    let mut pairs = crowd.pairs(bits);
    while pairs > few {
        let moves = (0..6).filter_map(|i| moved(bits, most, [i / 2, (i / 2 + 1 + i % 2) % 3]));
        let Some((fewest, best)) = moves.map(|bits| (crowd.pairs(bits), bits)).min() else { break };
        if fewest + pairs / GAIN >= pairs {
            break;
        }
        (pairs, bits) = (fewest, best);
    }
    bits.map(|bits| if bits < FOLDED_LEAST.ilog2() { 1 } else { 1 << bits })
}

/// Half of an axis's cells, or all where they would be too few, for another axis.
fn moved(mut bits: [u32; 3], most: [u32; 3], [from, to]: [usize; 2]) -> Option<[u32; 3]> {
    let few = FOLDED_LEAST.ilog2();
    let taken = if bits[from] <= few { bits[from] } else { 1 };
    if taken == 0 || bits[to] + taken > most[to] {
        return None;
    }
    (bits[from], bits[to]) = (bits[from] - taken, bits[to] + taken);
    Some(bits)
}

/// Sampled boxes by cell.
struct Crowd {
    cells: Vec<[u64; 3]>,
    /// The round in which a slot was last met, and boxes that it has of that round.
    slots: Vec<[u16; 2]>,
    round: u16,
}

impl Crowd {
    /// Pairs of boxes that share a cell where each axis has so many bits of a cell's number.
    fn pairs(&mut self, bits: [u32; 3]) -> u64 {
        self.round += 1;
        let masks = bits.map(|bits| (1u64 << bits) - 1);
        let mut pairs = 0;
        for cell in &self.cells {
            let hash = (0..3).fold(0u64, |hash, axis| {
                (hash.rotate_left(21) ^ (cell[axis] & masks[axis]))
                    .wrapping_mul(0x9e37_79b9_7f4a_7c15)
            });
            let slot = &mut self.slots[(hash >> (64 - SLOTS_BITS)) as usize];
            if slot[0] != self.round {
                *slot = [self.round, 0];
            }
            pairs += u64::from(slot[1]);
            slot[1] += 1;
        }
        pairs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const CUBES: [f32; 3] = [1.0; 3];

    fn fold(mins: &[[f32; 3]], counts: [f32; 3], limit: f32) -> [u32; 3] {
        let cells = folded(mins.iter().copied(), CUBES, counts, limit);
        assert!(cells.iter().map(|count| u64::from(*count)).product::<u64>() <= limit as u64);
        let is_whole = |count: &u32| *count == 1 || (*count >= 4 && count.is_power_of_two());
        assert!(cells.iter().all(is_whole), "{cells:?}");
        cells
    }

    /// Pairs of boxes that share a cell.
    fn pairs(mins: &[[f32; 3]], cells: [u32; 3]) -> usize {
        let cell = |min: &[f32; 3]| [0, 1, 2].map(|axis| min[axis] as u32 % cells[axis]);
        let mut all: Vec<_> = mins.iter().map(cell).collect();
        all.sort_unstable();
        all.chunk_by(|a, b| a == b).map(|some| some.len() * (some.len() - 1) / 2).sum()
    }

    #[test]
    fn a_table_is_folded_evenly_where_boxes_are_spread_evenly() {
        let mut random = Random(5);
        let mins: Vec<_> = (0..1_000).map(|_| [0; 3].map(|_| random.below(1_000) as f32)).collect();
        assert_eq!(fold(&mins, [1_000.0; 3], 32_768.0), [32; 3]);
    }

    #[test]
    fn rows_far_apart_are_not_folded_onto_themselves() {
        let positions = [[0.0, 0.0, 0.0], [1e5, 4e4, 7e4], [3e4, 9e4, 2e4]];
        for along in 0..3 {
            let row = |i: u32| {
                let mut min = positions[i as usize % 3];
                min[along] += 3.0 * i as f32;
                min
            };
            let mins: Vec<_> = (0..1_000).map(row).collect();
            let cells = fold(&mins, [1e5; 3], 32_768.0);
            let (found, even) = (pairs(&mins, cells), pairs(&mins, [32; 3]));
            assert!(10 * found < even, "{cells:?}: {found} pairs, evenly {even}");
        }
    }

    #[test]
    fn short_axes_and_small_tables_fold_too() {
        assert_eq!(fold(&[], [1e6, 1.0, 1.0], 512.0), [512, 1, 1]);
        assert_eq!(fold(&[[0.0; 3], [f32::INFINITY; 3], [f32::MIN; 3]], [1e6; 3], 1.0), [1; 3]);
        // Two cells would each be the neighbour of the other on both sides.
        assert_eq!(fold(&[[0.0; 3]; 9], [2.0, 2.0, 1e6], 4_096.0), [1, 1, 1_024]);
    }
}
