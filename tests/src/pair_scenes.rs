//! Sets of pairs with the structure of real scenes, without boxes.

use std::collections::BTreeSet;

use pairmask_core::BoxCount;

use crate::oracle::Pair;
use crate::stress_scenes::Rng;

/// About `count` random pairs, each once, sorted.
pub fn random_pairs(n: BoxCount, count: usize, seed: u64) -> Vec<Pair> {
    if n.get() < 2 {
        return Vec::new();
    }
    let mut rng = Rng::new(seed);
    let drawn = (0..count).map(|_| (rng.below(n.get()), rng.below(n.get())));
    let pairs: BTreeSet<Pair> = drawn.filter(|(a, b)| a != b).map(sorted).collect();
    pairs.into_iter().collect()
}

/// Every pair of `n` boxes.
pub fn all_pairs(n: BoxCount) -> Vec<Pair> {
    (0..n.get()).flat_map(|a| (a + 1..n.get()).map(move |b| (a, b))).collect()
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
            pairs.insert((a, b));
        }
    }
    pairs.into_iter().collect()
}

/// The pairs of positions as pairs of the boxes at them.
pub fn renamed(pairs: &[Pair], order: &[u32]) -> Vec<Pair> {
    let named = pairs.iter().map(|&(p, q)| (order[p as usize], order[q as usize]));
    let mut pairs: Vec<Pair> = named.map(sorted).collect();
    pairs.sort_unstable();
    pairs
}

fn sorted((a, b): Pair) -> Pair {
    (a.min(b), a.max(b))
}

/// A random order of `n` boxes.
pub fn random_order(n: BoxCount, seed: u64) -> Vec<u32> {
    let mut rng = Rng::new(seed);
    let mut order: Vec<u32> = (0..n.get()).collect();
    for i in (1..n.get()).rev() {
        order.swap(i as usize, rng.below(i + 1) as usize);
    }
    order
}
