//! parry3d's bounding volume hierarchy, traversed against itself.

use pairmask_core::Aabb;
use parry3d::bounding_volume::Aabb as ParryBox;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhLeafUpdateStatus, BvhWorkspace};
use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use rayon::slice::ParallelSlice;

use pairmask_tests::oracle::Pair;
use pairmask_tests::peers::contender::{Contender, ContenderError, Tally};
use pairmask_tests::peers::parry_scene::refit;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Upkeep {
    /// Boxes of inner nodes follow; the tree's shape stays.
    Refit,
    /// As `Refit`, after a few subtrees were built anew (about 5 % a frame).
    OptimizeRefit,
}

pub struct Parry {
    tree: Bvh,
    workspace: BvhWorkspace,
    upkeep: Upkeep,
    threads: usize,
    updates: Vec<(ParryBox, u32, f32)>,
    statuses: Vec<BvhLeafUpdateStatus>,
}

fn parry_box(b: &Aabb) -> ParryBox {
    ParryBox::new(Vector::from_array(b.min), Vector::from_array(b.max))
}

impl Parry {
    pub fn new(boxes: &[Aabb], upkeep: Upkeep, threads: usize) -> Self {
        let leaves: Vec<ParryBox> = boxes.iter().map(parry_box).collect();
        Self {
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves),
            workspace: BvhWorkspace::default(),
            upkeep,
            threads,
            updates: Vec::new(),
            statuses: Vec::new(),
        }
    }

    fn update_leaves(&mut self, boxes: &[Aabb]) {
        if self.threads > 1 {
            let update = |(i, b): (usize, &Aabb)| (parry_box(b), i as u32, 0.0);
            boxes.par_iter().enumerate().map(update).collect_into_vec(&mut self.updates);
            self.tree.insert_or_update_batch_partially_parallel(&self.updates, &mut self.statuses);
        } else {
            for (i, b) in (0u32..).zip(boxes) {
                self.tree.insert_or_update_partially(parry_box(b), i, 0.0);
            }
        }
    }

    fn follow(&mut self) {
        if self.upkeep == Upkeep::OptimizeRefit {
            self.tree.optimize_incremental(&mut self.workspace);
        }
        refit(&mut self.tree, &mut self.workspace, self.threads);
    }
}

impl Contender for Parry {
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError> {
        self.update_leaves(boxes);
        self.follow();
        if self.threads > 1 {
            let pairs = self.tree.traverse_bvtt_single_tree_parallel::<false>();
            let tally = |pairs: &[(u32, u32)]| {
                let mut tally = Tally::default();
                for (a, b) in pairs {
                    tally.iterate(*a, *b);
                }
                tally
            };
            Ok(pairs.par_chunks(65_536).map(tally).reduce(Tally::default, Tally::plus))
        } else {
            let mut tally = Tally::default();
            self.tree.traverse_bvtt_single_tree::<false>(&mut self.workspace, &mut |a, b| {
                tally.iterate(a, b);
            });
            Ok(tally)
        }
    }

    fn pairs(&mut self, _: &[Aabb]) -> Result<Vec<Pair>, ContenderError> {
        let mut pairs = Vec::new();
        self.tree.traverse_bvtt_single_tree::<false>(&mut self.workspace, &mut |a, b| {
            pairs.push([a, b]);
        });
        Ok(pairs)
    }
}
