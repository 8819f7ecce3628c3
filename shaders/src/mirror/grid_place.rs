//! `grid_place`: the position of each box, by cell and then by index.

use super::Home;

/// Box at each position.
pub(super) fn order(homes: &[Home]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..homes.len() as u32).collect();
    order.sort_by_key(|index| homes[*index as usize].cell);
    order
}
