//! What else finds the pairs of the demo's boxes, on one thread each: a naive loop, and parry3d's tree.

use pairmask_core::Aabb;
use pairmask_core::oracle::Pair;
use parry3d::bounding_volume::Aabb as ParryBox;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};

/// Every box with every other one, as one would write it first.
pub fn naive(boxes: &[Aabb], pairs: &mut Vec<Pair>) {
    pairs.clear();
    for (a, p) in (0..).zip(boxes) {
        for (b, q) in (a + 1..).zip(&boxes[a as usize + 1..]) {
            if (0..3).all(|axis| p.min[axis] <= q.max[axis] && q.min[axis] <= p.max[axis]) {
                pairs.push([a, b]);
            }
        }
    }
}

/// parry3d's tree, kept from frame to frame: leaves are updated, parts of it built anew, and it is traversed against
/// itself, as rapier3d does.
pub struct ParryTree {
    tree: Bvh,
    workspace: BvhWorkspace,
}

fn parry_box(b: &Aabb) -> ParryBox {
    ParryBox::new(Vector::from_array(b.min), Vector::from_array(b.max))
}

impl ParryTree {
    pub fn new(boxes: &[Aabb]) -> Self {
        let leaves: Vec<ParryBox> = boxes.iter().map(parry_box).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves);
        Self { tree, workspace: BvhWorkspace::default() }
    }

    pub fn find(&mut self, boxes: &[Aabb], pairs: &mut Vec<Pair>) {
        pairs.clear();
        for (i, b) in (0..).zip(boxes) {
            self.tree.insert_or_update_partially(parry_box(b), i, 0.0);
        }
        self.tree.optimize_incremental(&mut self.workspace);
        self.tree.refit(&mut self.workspace);
        self.tree.traverse_bvtt_single_tree::<false>(&mut self.workspace, &mut |a, b| {
            pairs.push([a, b]);
        });
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::oracle::truth;

    use super::*;
    use crate::cli::demo::world::World;

    #[test]
    fn each_finds_all_pairs_of_boxes_in_motion() {
        let mut world = World::new(300, 3);
        let (mut tree, mut pairs) = (ParryTree::new(world.boxes()), Vec::new());
        for _ in 0..60 {
            world.step();
            let truth = truth(world.boxes()).pairs;
            naive(world.boxes(), &mut pairs);
            assert_eq!(pairs, truth);
            tree.find(world.boxes(), &mut pairs);
            for pair in &mut pairs {
                pair.sort_unstable();
            }
            pairs.sort_unstable();
            assert_eq!(pairs, truth);
            world.push_apart(&truth);
        }
    }
}
