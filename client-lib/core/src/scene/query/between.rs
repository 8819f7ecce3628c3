//! Set A against set B: pairs of a box of one and a box of the other, of boxes that no scene keeps.
//!
//! A coarse sieve of the smaller set takes those boxes of the larger one away that are far from all of it.
//! Of what is left, the larger set is placed in cells, and the smaller one asks. So nothing takes time in
//! proportion to the pairs within a set.

use super::Room;
use super::{around, crowded, direct};
use crate::aabb::Aabb;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::cast::BoxTree;
use crate::engine::CullError;
use crate::floats;
use crate::scene::cells::{Cells, is_valid};
use crate::scene::pair_list::{Pair, Sorter};
use crate::team::{self, in_parts, part_count};

/// Most boxes of a set: cells count them in 29 bits.
pub(super) const MOST_OF_A_SET: usize = (1 << 29) - 1;
/// Comparisons up to which each is made: some 100 µs.
const FEW_TESTS: u64 = 1 << 17;
const TASK_BOXES: usize = 16_384;
/// A box of either set takes so long on one thread, ns: most are sieved out.
const SET_NS: f64 = 20.0;
/// Cells of the sieve along an axis: a row of them is a word.
const SIEVE: usize = 64;
/// Coordinates beyond that share the outermost cells, so that lengths are finite.
const FARTHEST: f32 = 1e37;

/// Finds the pairs [a, b] of a box of each set that overlap, by a and then by b, the same on any number of
/// threads (of the rayon pool; `None` is all). Boxes of one set are no pair. Returns how many pairs were
/// tested.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::scene::between;
///
/// let a = [Aabb::new([0.0; 3], [2.0; 3]); 2];
/// let b = [Aabb::point([9.0; 3]), Aabb::point([1.0; 3])];
/// let mut found = Vec::new();
/// between(&a, &b, None, u64::from(u32::MAX), &mut found)?;
/// assert_eq!(found, [[0, 1], [1, 1]]);
/// # Ok::<(), pairmask_core::engine::CullError>(())
/// ```
///
/// # Errors
/// [`CullError::Reserve`] where there are more than `most_pairs`, or 2^32 or more, or no memory for them.
///
/// # Panics
/// Where a set has 2^29 boxes or more.
pub fn between(
    first: &[Aabb],
    second: &[Aabb],
    threads: Option<usize>,
    most_pairs: u64,
    found: &mut Vec<Pair>,
) -> Result<u64, CullError> {
    between_unless(&Cancel::never(), [first, second], threads, most_pairs, found)
}

/// The same, unless cancelled.
pub(super) fn between_unless(
    cancel: &Cancel,
    [first, second]: [&[Aabb]; 2],
    threads: Option<usize>,
    most_pairs: u64,
    found: &mut Vec<Pair>,
) -> Result<u64, CullError> {
    assert!(first.len().max(second.len()) <= MOST_OF_A_SET, "cells count boxes in 29 bits");
    found.clear();
    if first.is_empty() || second.is_empty() {
        return Ok(0);
    }
    let boxes = (first.len() + second.len()) as f64;
    let threads = team::threads_for(boxes * SET_NS, threads);
    let _team = team::enter(threads);
    let most_pairs = most_pairs.min(u64::from(u32::MAX));
    let is_first_small = first.len() <= second.len();
    let (small, large) = if is_first_small { (first, second) } else { (second, first) };
    let few = |a: usize, b: usize| a as u64 * b as u64 <= FEW_TESTS;
    if few(small.len(), large.len()) {
        let room = Room::new(most_pairs, small.len(), large.len(), cancel);
        let tested = direct::find(large, small, threads, &room, found)?;
        settle(found, !is_first_small, first.len(), (threads, cancel));
        room.check()?;
        return Ok(tested);
    }
    let (indices, left) = Sieve::of(small).left_of(large, threads, cancel);
    let asks_small = small.len() <= left.len();
    let (queries, boxes) = if asks_small { (small, &left[..]) } else { (&left[..], small) };
    let room = &Room::new(most_pairs, queries.len(), boxes.len(), cancel);
    room.check()?;
    let tested = if boxes.is_empty() {
        0
    } else if few(queries.len(), boxes.len()) {
        direct::find(boxes, queries, threads, room, found)?
    } else {
        let cells = Cells::of(boxes, |_| false, threads);
        let memory = &mut around::Memory::default();
        let tested = around::find(&cells, boxes, queries, threads, room, memory, found)?;
        if let Some(tested) = tested {
            tested
        } else {
            let tree = BoxTree::unless(cancel, boxes, threads).ok_or(CullError::Cancelled)?;
            let room = Room::new(most_pairs, queries.len(), boxes.len(), cancel);
            crowded::find(&tree, boxes, queries, threads, &room, found)?
        }
    };
    let of_large = usize::from(asks_small);
    for pair in found.iter_mut() {
        pair[of_large] = indices[pair[of_large] as usize];
    }
    let is_in_order = asks_small == is_first_small;
    settle(found, !is_in_order, first.len(), (threads, cancel));
    room.check()?;
    Ok(tested)
}

/// Turns pairs of which the second box is of the first set, and puts them in order.
fn settle(
    found: &mut Vec<Pair>,
    are_turned: bool,
    first: usize,
    (threads, cancel): (usize, &Cancel),
) {
    if are_turned {
        for pair in found.iter_mut() {
            pair.reverse();
        }
        Sorter::default().sort(found, first as u32, threads, cancel);
    }
}

/// Where the boxes of a set are, about: a bit a cell.
struct Sieve {
    origin: [f32; 3],
    per_unit: [f32; 3],
    rows: Vec<u64>,
}

impl Sieve {
    fn of(boxes: &[Aabb]) -> Self {
        floats::with_default(|| {
            let (mut low, mut high) = ([FARTHEST; 3], [-FARTHEST; 3]);
            for b in boxes.iter().filter(|b| is_valid(b)) {
                for axis in 0..3 {
                    low[axis] = low[axis].min(b.min[axis].max(-FARTHEST));
                    high[axis] = high[axis].max(b.max[axis].min(FARTHEST));
                }
            }
            let per_unit = |axis: usize| {
                let scale = SIEVE as f32 / (high[axis] - low[axis]);
                if scale.is_finite() && scale > 0.0 { scale } else { 1.0 }
            };
            let per_unit = [per_unit(0), per_unit(1), per_unit(2)];
            let mut sieve = Self { origin: low, per_unit, rows: vec![0; SIEVE * SIEVE] };
            for b in boxes.iter().copied().filter(is_valid) {
                let (word, [ys, zs]) = sieve.cells_of(&b);
                for z in zs {
                    for y in ys.clone() {
                        sieve.rows[z * SIEVE + y] |= word;
                    }
                }
            }
            sieve
        })
    }

    /// The cells of a valid box: those along x as bits, those along y and z as ranges. A coordinate's map is
    /// monotone, so that boxes that overlap share a cell.
    #[inline(always)]
    fn cells_of(&self, b: &Aabb) -> (u64, [std::ops::RangeInclusive<usize>; 2]) {
        debug_assert!(floats::are_default());
        let cell = |axis: usize, x: f32| {
            let cells = (x - self.origin[axis]) * self.per_unit[axis];
            cells.max(0.0).min((SIEVE - 1) as f32) as usize
        };
        let [xs, ys, zs] = [0, 1, 2].map(|axis| cell(axis, b.min[axis])..=cell(axis, b.max[axis]));
        let word = u64::MAX << xs.start() & u64::MAX >> (SIEVE - 1 - xs.end());
        (word, [ys, zs])
    }

    /// Whether a box may overlap one of the set.
    #[inline(always)]
    fn keeps(&self, b: &Aabb) -> bool {
        if !is_valid(b) {
            return false;
        }
        let (word, [ys, zs]) = self.cells_of(b);
        zs.into_iter().any(|z| {
            let rows = &self.rows[z * SIEVE..][..SIEVE];
            rows.get(ys.clone()).is_some_and(|rows| rows.iter().any(|row| row & word != 0))
        })
    }

    /// The boxes that may overlap one of the set, and their indices; unless cancelled.
    fn left_of(&self, boxes: &[Aabb], threads: usize, cancel: &Cancel) -> (Vec<u32>, Vec<Aabb>) {
        let parts = part_count(boxes.len(), TASK_BOXES, threads);
        let step = boxes.len().div_ceil(parts).max(1);
        let mut work: Vec<(u32, &[Aabb])> =
            (0u32..).step_by(step).zip(boxes.chunks(step)).collect();
        let run = |work: &mut [(u32, &[Aabb])]| {
            let (mut indices, mut left, mut pace) = (Vec::new(), Vec::new(), Pace::default());
            for (first, boxes) in work {
                // Copies: another process may write boxes while they are read.
                let boxes = (*first..).zip(boxes.iter().copied());
                for (index, b) in boxes {
                    if cancel.look_after(BOX_TESTS, &mut pace) {
                        return (indices, left);
                    }
                    if !self.keeps(&b) {
                        continue;
                    }
                    indices.push(index);
                    left.push(b);
                }
            }
            (indices, left)
        };
        in_parts(work.as_mut_slice(), parts, &run, &|mut low: (Vec<u32>, Vec<Aabb>), high| {
            low.0.extend(high.0);
            low.1.extend(high.1);
            low
        })
    }
}
