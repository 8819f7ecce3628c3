//! Comparing each query with each box.

use super::Room;
use crate::aabb::{Aabb, KeyBox};
use crate::cancel::Pace;
use crate::engine::CullError;
use crate::scene::pair_list::Pair;
use crate::team::{appended, in_parts, part_count};

/// Queries that are compared with a box at a time.
const LANES: usize = 8;
/// Comparisons of a task, at least: 32 µs.
const TASK_TESTS: usize = 32_768;

/// Some queries, as keys by axis.
struct Block {
    first: u32,
    min: [[i32; LANES]; 3],
    max: [[i32; LANES]; 3],
}

impl Block {
    fn of(first: u32, queries: &[Aabb]) -> Self {
        let mut block = Self { first, min: [[i32::MAX; LANES]; 3], max: [[i32::MIN; LANES]; 3] };
        for (lane, query) in queries.iter().enumerate() {
            let keys = KeyBox::from(query);
            for axis in 0..3 {
                block.min[axis][lane] = keys.min[axis];
                block.max[axis][lane] = keys.max[axis];
            }
        }
        block
    }

    /// The lanes that overlap a box are those that are 0.
    #[inline(always)]
    fn apart(&self, b: &KeyBox) -> [i32; LANES] {
        let mut apart = [0; LANES];
        for axis in 0..3 {
            for (lane, apart) in apart.iter_mut().enumerate() {
                *apart |= i32::from(self.min[axis][lane] > b.max[axis])
                    | i32::from(b.min[axis] > self.max[axis][lane]);
            }
        }
        apart
    }
}

/// Finds the boxes that queries overlap. Returns how many comparisons were made.
pub(super) fn find(
    boxes: &[Aabb],
    queries: &[Aabb],
    threads: usize,
    room: &Room<'_>,
    found: &mut Vec<Pair>,
) -> Result<u64, CullError> {
    let blocks = (0u32..).step_by(LANES).zip(queries.chunks(LANES));
    let blocks: Vec<Block> = blocks.map(|(first, some)| Block::of(first, some)).collect();
    let parts = part_count(boxes.len(), (TASK_TESTS / queries.len().max(1)).max(1), threads);
    let step = boxes.len().div_ceil(parts).max(1);
    let mut work: Vec<(u32, &[Aabb])> = (0u32..).step_by(step).zip(boxes.chunks(step)).collect();
    let run = |work: &mut [(u32, &[Aabb])]| {
        let (mut pairs, mut pace) = (Vec::new(), Pace::default());
        for (first, boxes) in work {
            for (index, b) in (*first..).zip(*boxes) {
                if room.cancel.look_after(queries.len() as u64, &mut pace) {
                    return pairs;
                }
                let before = pairs.len();
                add_pairs(&blocks, index, &KeyBox::from(b), &mut pairs);
                if pairs.len() > before && !room.take(pairs.len() - before, 0) {
                    return pairs;
                }
            }
        }
        pairs
    };
    let by_index = in_parts(work.as_mut_slice(), parts, &run, &appended);
    room.check()?;
    super::reserve(found, by_index.len())?;
    super::by_query(|| by_index.iter(), queries.len(), &mut Vec::new(), found);
    Ok(boxes.len() as u64 * queries.len() as u64)
}

/// Adds the queries that overlap a box.
#[inline]
fn add_pairs(blocks: &[Block], index: u32, keys: &KeyBox, pairs: &mut Vec<Pair>) {
    for block in blocks {
        let apart = block.apart(keys);
        if apart.iter().fold(1, |all, apart| all & apart) == 0 {
            let lanes = (block.first..).zip(apart).filter(|(_, apart)| *apart == 0);
            pairs.extend(lanes.map(|(query, _)| [query, index]));
        }
    }
}
