//! Sets of pairs with the structure of real scenes, without boxes, and replies from lists of pairs: the naive writers
//! that the decoders are tested against.

use std::collections::BTreeSet;

use pairmask_core::BoxCount;
use pairmask_core::mask::MaskShape;

use crate::oracle::Pair;
use crate::stress_scenes::Rng;

/// About `count` random pairs, each once, sorted.
pub fn random_pairs(n: BoxCount, count: usize, seed: u64) -> Vec<Pair> {
    if n.get() < 2 {
        return Vec::new();
    }
    let mut rng = Rng::new(seed);
    let drawn = (0..count).map(|_| [rng.below(n.get()), rng.below(n.get())]);
    let pairs: BTreeSet<Pair> = drawn.filter(|[a, b]| a != b).map(sorted).collect();
    pairs.into_iter().collect()
}

pub fn all_pairs(n: BoxCount) -> Vec<Pair> {
    (0..n.get()).flat_map(|a| (a + 1..n.get()).map(move |b| [a, b])).collect()
}

/// About `per_box`·n pairs as a grid finds them, by position in the grid's order: a partner lies
/// in one of the five runs of cells in the forward half of the neighbourhood.
pub fn grid_like_pairs(n: BoxCount, per_box: f64, seed: u64) -> Vec<Pair> {
    let mut rng = Rng::new(seed);
    let side = f64::from(n.get()).cbrt();
    let runs = [0.0, side, side * side - side, side * side, side * side + side];
    let mut pairs = BTreeSet::new();
    for _ in 0..(per_box * f64::from(n.get())) as usize {
        let a = rng.below(n.get());
        let run = runs[rng.below(5) as usize] as u32;
        let b = a.saturating_add(run + 1 + rng.below(12));
        if b < n.get() {
            pairs.insert([a, b]);
        }
    }
    pairs.into_iter().collect()
}

/// The pairs of positions as pairs of the boxes at them.
pub fn renamed(pairs: &[Pair], order: &[u32]) -> Vec<Pair> {
    let named = pairs.iter().map(|&[p, q]| [order[p as usize], order[q as usize]]);
    let mut pairs: Vec<Pair> = named.map(sorted).collect();
    pairs.sort_unstable();
    pairs
}

fn sorted([a, b]: Pair) -> Pair {
    [a.min(b), a.max(b)]
}

pub fn random_order(n: BoxCount, seed: u64) -> Vec<u32> {
    let mut rng = Rng::new(seed);
    let mut order: Vec<u32> = (0..n.get()).collect();
    for i in (1..n.get()).rev() {
        order.swap(i as usize, rng.below(i + 1) as usize);
    }
    order
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenMask {
    pub n: BoxCount,
    pub shape: MaskShape,
    pub reply: Vec<u32>,
}

/// The dense mask of `pairs`, bit by bit from the definition of the pair index.
pub fn write_dense(n: BoxCount, pairs: &[Pair]) -> WrittenMask {
    let mut reply = vec![0; n.dense_words() as usize];
    let boxes = u64::from(n.get());
    for &[a, b] in pairs {
        assert!(a < b && b < n.get(), "({a}, {b}) is no pair of {boxes} boxes");
        let (a, b) = (u64::from(a), u64::from(b));
        let k = a * (2 * boxes - a - 1) / 2 + b - a - 1;
        reply[(k / 32) as usize] |= 1 << (k % 32);
    }
    WrittenMask { n, shape: MaskShape::dense(n), reply }
}

/// The sparse mask of `pairs`; with an order, rows and columns are positions in it.
pub fn write_sparse(n: BoxCount, pairs: &[Pair], order: Option<&[u32]>) -> WrittenMask {
    let position = order.map(|order| {
        assert_eq!(order.len(), n.len(), "an order names every box");
        let mut position = vec![u32::MAX; n.len()];
        for (p, index) in (0..).zip(order) {
            position[*index as usize] = p;
        }
        assert!(!position.contains(&u32::MAX), "an order names every box once");
        position
    });
    let mut bits: Vec<(u32, u32, u32)> = pairs
        .iter()
        .map(|&[a, b]| {
            assert!(a < b && b < n.get(), "({a}, {b}) is no pair of {} boxes", n.get());
            let (p, q) = position.as_ref().map_or((a, b), |of| (of[a as usize], of[b as usize]));
            let (row, column) = (p.min(q), p.max(q));
            (row, column / 32, 1 << (column % 32))
        })
        .collect();
    bits.sort_unstable();
    let mut words: Vec<(u32, u32, u32)> = Vec::new();
    for (row, block, bit) in bits {
        match words.last_mut() {
            Some(word) if (word.0, word.1) == (row, block) => word.2 |= bit,
            _ => words.push((row, block, bit)),
        }
    }
    let count = words.len() as u64;
    let shape = MaskShape::sparse(n, count, count, order.is_some());
    let mut reply = vec![0; shape.extent_words() as usize];
    if let MaskShape::Sparse { rows, blocks, bits, order: positions } = &shape {
        for (i, word) in words.iter().enumerate() {
            reply[rows.start as usize + i] = word.0;
            reply[blocks.start as usize + i] = word.1;
            reply[bits.start as usize + i] = word.2;
        }
        if let (Some(span), Some(order)) = (positions, order) {
            reply[span.start as usize..].copy_from_slice(order);
        }
    }
    WrittenMask { n, shape, reply }
}

/// The list of `pairs`, in the order given.
pub fn write_list(n: BoxCount, pairs: &[Pair]) -> WrittenMask {
    let mut reply = Vec::with_capacity(2 * pairs.len());
    for &[a, b] in pairs {
        assert!(a < b && b < n.get(), "({a}, {b}) is no pair of {} boxes", n.get());
        reply.extend([a, b]);
    }
    WrittenMask { n, shape: MaskShape::list(pairs.len() as u64), reply }
}
