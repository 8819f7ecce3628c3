//! obvhs's two-way hierarchy: one box query a leaf, in the order in which leaves lie in the tree.

use obvhs::aabb::Aabb as ObvhsBox;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use pairmask::Aabb;
use pairmask::glam::Vec3A;
use rayon::iter::ParallelIterator;
use rayon::slice::ParallelSlice;

use super::contender::{Contender, ContenderError};
use super::tally::Tally;
use crate::oracle::Pair;

/// Leaves of one task: some 50 µs of queries.
const CHUNK: usize = 256;

/// How the tree follows the boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Upkeep {
    /// Boxes of inner nodes follow; the tree's shape stays.
    Refit,
    /// Built anew by parallel locally-ordered clustering.
    Rebuild,
}

/// A tree.
pub struct Obvhs {
    tree: Bvh2,
    builder: PlocBuilder,
    boxes: Vec<ObvhsBox>,
    /// Leaf nodes as they lie in the tree.
    leaves: Vec<u32>,
    upkeep: Upkeep,
    threads: usize,
}

fn obvhs_box(b: &Aabb) -> ObvhsBox {
    ObvhsBox::new(Vec3A::from_array(b.min), Vec3A::from_array(b.max))
}

impl Obvhs {
    /// A tree of the first frame's boxes.
    pub fn new(boxes: &[Aabb], upkeep: Upkeep, threads: usize) -> Self {
        let mut peer = Self {
            tree: Bvh2::default(),
            builder: PlocBuilder::with_capacity(boxes.len()),
            boxes: Vec::new(),
            leaves: Vec::new(),
            upkeep,
            threads,
        };
        // A tree that stays is worth a better build than one for a single frame.
        let (distance, passes) = match upkeep {
            Upkeep::Refit => (PlocSearchDistance::Medium, 2),
            Upkeep::Rebuild => (PlocSearchDistance::Minimum, 0),
        };
        peer.build(boxes, distance, passes);
        peer
    }

    fn build(&mut self, boxes: &[Aabb], distance: PlocSearchDistance, passes: usize) {
        self.boxes.clear();
        self.boxes.extend(boxes.iter().map(obvhs_box));
        let mut indices = std::mem::take(&mut self.tree.primitive_indices);
        indices.clear();
        indices.extend(0..boxes.len() as u32);
        let precision = SortPrecision::U64;
        self.builder.build_with_bvh(
            &mut self.tree,
            distance,
            &self.boxes,
            indices,
            precision,
            passes,
        );
        if self.upkeep == Upkeep::Refit {
            self.tree.reorder_in_stack_traversal_order();
            self.tree.update_primitives_to_nodes();
        }
        self.leaves.clear();
        let nodes = (0u32..).zip(&self.tree.nodes);
        self.leaves.extend(nodes.filter(|(_, node)| node.is_leaf()).map(|(i, _)| i));
    }

    fn follow(&mut self, boxes: &[Aabb]) {
        match self.upkeep {
            Upkeep::Rebuild => self.build(boxes, PlocSearchDistance::Minimum, 0),
            Upkeep::Refit => {
                for (b, &node) in boxes.iter().zip(&self.tree.primitives_to_nodes) {
                    self.tree.nodes[node as usize].set_aabb(obvhs_box(b));
                }
                self.tree.refit_all();
            }
        }
    }

    /// Calls `visit` for each pair of a leaf of `leaves` and a box of higher index.
    fn query(&self, leaves: &[u32], mut visit: impl FnMut(u32, u32)) {
        let index = |node: u32| {
            self.tree.primitive_indices[self.tree.nodes[node as usize].first_index as usize]
        };
        for &leaf in leaves {
            let a = index(leaf);
            self.tree.aabb_traverse(*self.tree.nodes[leaf as usize].aabb(), |_, node| {
                let b = index(node);
                if a < b {
                    visit(a, b);
                }
                true
            });
        }
    }

    fn tally(&self, leaves: &[u32]) -> Tally {
        let mut tally = Tally::default();
        self.query(leaves, |a, b| tally.visit(a, b));
        tally
    }
}

impl Contender for Obvhs {
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError> {
        self.follow(boxes);
        if self.threads > 1 {
            let chunks = self.leaves.par_chunks(CHUNK);
            Ok(chunks.map(|leaves| self.tally(leaves)).reduce(Tally::default, Tally::plus))
        } else {
            Ok(self.tally(&self.leaves))
        }
    }

    fn pairs(&mut self, _: &[Aabb]) -> Result<Vec<Pair>, ContenderError> {
        let mut pairs = Vec::new();
        self.query(&self.leaves, |a, b| pairs.push((a, b)));
        Ok(pairs)
    }
}
