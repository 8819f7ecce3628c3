//! rstar's R*-tree, bulk-loaded each frame.

use pairmask_core::Aabb;
use rayon::iter::ParallelIterator;
use rayon::slice::ParallelSlice;
use rstar::{AABB, RTree, RTreeObject};

use pairmask_tests::oracle::Pair;
use pairmask_tests::peers::contender::{Contender, ContenderError, Tally};

/// Boxes of one task: some 100 µs of queries.
const CHUNK: usize = 256;

/// A box with its index.
#[derive(Clone, Copy)]
struct Leaf {
    bounds: AABB<[f32; 3]>,
    index: u32,
}

impl RTreeObject for Leaf {
    type Envelope = AABB<[f32; 3]>;

    fn envelope(&self) -> Self::Envelope {
        self.bounds
    }
}

/// A tree.
pub struct Rstar {
    tree: RTree<Leaf>,
    threads: usize,
}

impl Rstar {
    /// No tree yet: every frame builds one.
    pub fn new(threads: usize) -> Self {
        Self { tree: RTree::new(), threads }
    }

    /// On one thread: the tree against itself, which names each pair twice, and each box with
    /// itself.
    fn traverse(&self, mut visit: impl FnMut(u32, u32)) {
        for (a, b) in self.tree.intersection_candidates_with_other_tree(&self.tree) {
            if a.index < b.index {
                visit(a.index, b.index);
            }
        }
    }

    /// On more: a query for each box.
    fn query(&self, leaves: &[Leaf]) -> Tally {
        let mut tally = Tally::default();
        for a in leaves {
            for b in self.tree.locate_in_envelope_intersecting(a.bounds) {
                if a.index < b.index {
                    tally.visit(a.index, b.index);
                }
            }
        }
        tally
    }
}

impl Contender for Rstar {
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError> {
        let leaf =
            |(index, b): (u32, &Aabb)| Leaf { bounds: AABB::from_corners(b.min, b.max), index };
        self.tree = RTree::bulk_load((0..).zip(boxes).map(leaf).collect());
        if self.threads > 1 {
            // As they lie in the tree: neighbours' queries touch the same nodes.
            let leaves: Vec<Leaf> = self.tree.iter().copied().collect();
            let chunks = leaves.par_chunks(CHUNK);
            Ok(chunks.map(|leaves| self.query(leaves)).reduce(Tally::default, Tally::plus))
        } else {
            let mut tally = Tally::default();
            self.traverse(|a, b| tally.visit(a, b));
            Ok(tally)
        }
    }

    fn pairs(&mut self, _: &[Aabb]) -> Result<Vec<Pair>, ContenderError> {
        let mut pairs = Vec::new();
        self.traverse(|a, b| pairs.push((a, b)));
        Ok(pairs)
    }
}
