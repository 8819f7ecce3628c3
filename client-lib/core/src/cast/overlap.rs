//! The boxes of a tree that may overlap a box.

use super::node::{FAN_OUT, Node};
use super::tree::BoxTree;
use crate::aabb::Aabb;
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// What a search for overlaps has before it: groups by level and number. Memory is kept from one to the next.
#[derive(Debug, Default)]
pub(crate) struct Ahead {
    groups: Vec<(u32, u32)>,
}

impl BoxTree {
    /// Adds the indices of all boxes that overlap a valid box. Where that is infinite, some that overlap nothing may be
    /// among them, and some beyond all boxes. Needs the default floating-point flags. Returns how many boxes and groups were
    /// looked at.
    pub(crate) fn add_overlapping(&self, b: &Aabb, ahead: &mut Ahead, found: &mut Vec<u32>) -> u64 {
        descend(self, b, ahead, found, AvailableIsa::best())
    }
}

/// The lanes whose boxes overlap a box, one bit each.
#[inline(always)]
fn meeting(node: &Node, b: &Aabb) -> u32 {
    let mut meets = [1u32; FAN_OUT];
    for axis in 0..3 {
        let (mins, maxes, min, max) = (&node.min[axis], &node.max[axis], b.min[axis], b.max[axis]);
        for lane in 0..FAN_OUT {
            meets[lane] &= u32::from(mins[lane] <= max) & u32::from(min <= maxes[lane]);
        }
    }
    meets.iter().enumerate().fold(0, |bits, (lane, meets)| bits | meets << lane)
}

per_isa! {
    fn descend<simd: S>(tree: &BoxTree, b: &Aabb, ahead: &mut Ahead, found: &mut Vec<u32>) -> u64 {
        let _ = simd;
        let (leaves, levels) = (tree.leaves(), tree.levels());
        let groups = &mut ahead.groups;
        groups.clear();
        groups.push((levels.len() as u32, 0));
        let mut looked_at = 0;
        while let Some((level, group)) = groups.pop() {
            looked_at += FAN_OUT as u64;
            let below = (level as usize).checked_sub(1);
            let Some(below) = below else {
                // Bounds hold nothing where there are no more groups, but a box may be infinite.
                let Some(leaf) = leaves.get(group as usize) else { continue };
                let mut bits = meeting(&leaf.boxes, b);
                while bits != 0 {
                    let index = leaf.indices[bits.trailing_zeros() as usize];
                    found.push(index);
                    bits &= bits - 1;
                }
                continue;
            };
            let Some(node) = levels[below].get(group as usize) else { continue };
            let mut bits = meeting(node, b);
            while bits != 0 {
                groups.push((level - 1, group * FAN_OUT as u32 + bits.trailing_zeros()));
                bits &= bits - 1;
            }
        }
        looked_at
    }
}
