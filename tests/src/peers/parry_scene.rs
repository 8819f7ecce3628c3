//! parry3d's tree in the state of a persistent scene: only leaves that moved are updated, and pairs are
//! found by its own incremental ways. Its user keeps the list of pairs.
//!
//! * [`ParryWay::Changes`]: leaves grow by a margin, those that left theirs are marked as changed, and the
//!   tree is traversed against itself where it changed. The list is of pairs of fat leaves, as rapier's.
//! * [`ParryWay::Queries`]: leaves are the boxes, and each box that moved asks the tree for its partners.
//!   The list is of the boxes' own pairs.
//!
//! Few movers are taken out of the tree and inserted anew, and their ancestors alone follow; from one leaf
//! in [`BULK_SHARE`] on leaves change in place and the whole tree is optimised and refitted, as rapier does it.

use pairmask_core::Aabb;
use parry3d::bounding_volume::Aabb as ParryBox;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhLeafUpdateStatus, BvhWorkspace};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::contender::{ContenderError, remove, touches};
use crate::oracle::Pair;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParryWay {
    /// By traversing what changed of the tree against itself.
    Changes,
    /// By a query for each box that moved.
    Queries,
}

/// Leaves grow by this much on each side, in units of the scene (a box's edge is about one): rapier's.
const MARGIN: f32 = 0.04;
/// From one changed leaf in so many on the whole tree is refitted: rapier's threshold.
const BULK_SHARE: usize = 16;
/// From so many queries on they run on all threads.
const PARALLEL_QUERIES: usize = 256;

pub struct ParryScene {
    tree: Bvh,
    workspace: BvhWorkspace,
    way: ParryWay,
    threads: usize,
    boxes: Vec<Aabb>,
    /// For each box the boxes that it forms a pair with.
    partners: Vec<Vec<u32>>,
    changed: Vec<u32>,
    changed_before: Vec<u32>,
}

fn parry_box(b: &Aabb, margin: f32) -> ParryBox {
    let enlarged = |corner: [f32; 3], by: f32| Vector::from_array(corner.map(|x| x + by));
    ParryBox::new(enlarged(b.min, -margin), enlarged(b.max, margin))
}

pub fn refit(tree: &mut Bvh, workspace: &mut BvhWorkspace, threads: usize) {
    if threads > 1 {
        tree.refit_parallel(workspace);
    } else {
        tree.refit(workspace);
    }
}

impl ParryScene {
    pub fn new(boxes: &[Aabb], way: ParryWay, threads: usize) -> Self {
        let margin = if way == ParryWay::Changes { MARGIN } else { 0.0 };
        let leaves: Vec<ParryBox> = boxes.iter().map(|b| parry_box(b, margin)).collect();
        let mut scene = Self {
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves),
            workspace: BvhWorkspace::default(),
            way,
            threads,
            boxes: boxes.to_vec(),
            partners: vec![Vec::new(); boxes.len()],
            changed: Vec::new(),
            changed_before: Vec::new(),
        };
        // New leaves are pending, then changed: two refits until the tree is at rest.
        for _ in 0..2 {
            scene.tree.refit(&mut scene.workspace);
        }
        let partners = &mut scene.partners;
        scene.tree.traverse_bvtt_single_tree::<false>(&mut scene.workspace, &mut |a, b| {
            partners[a as usize].push(b);
            partners[b as usize].push(a);
        });
        scene
    }

    /// Sets the boxes that moved and keeps the list. Returns how many pairs began or ended.
    pub fn change(&mut self, moved: &[u32], boxes: &[Aabb]) -> Result<usize, ContenderError> {
        let is_bulk = moved.len() * BULK_SHARE >= self.boxes.len();
        std::mem::swap(&mut self.changed, &mut self.changed_before);
        self.changed.clear();
        let margin = if self.way == ParryWay::Changes { MARGIN } else { 0.0 };
        for &index in moved {
            let b = boxes[index as usize];
            self.boxes[index as usize] = b;
            let tight = parry_box(&b, 0.0);
            let status = if is_bulk {
                self.tree.insert_or_update_partially(tight, index, margin)
            } else {
                self.tree.reinsert_or_update_with_change_detection(tight, index, margin)
            };
            if status != BvhLeafUpdateStatus::Unchanged {
                self.changed.push(index);
            }
        }
        self.follow(is_bulk);
        match self.way {
            ParryWay::Changes => self.traverse_changes(),
            ParryWay::Queries => self.query(moved),
        }
    }

    fn follow(&mut self, is_bulk: bool) {
        let many = (self.changed.len() + self.changed_before.len()) * BULK_SHARE;
        if is_bulk {
            self.tree.optimize_incremental(&mut self.workspace);
        } else if many < self.boxes.len() {
            self.tree.refit_partial(&self.changed_before, &self.changed);
            return;
        }
        refit(&mut self.tree, &mut self.workspace, self.threads);
    }

    fn traverse_changes(&mut self) -> Result<usize, ContenderError> {
        let mut count = 0;
        for i in 0..self.changed.len() {
            let a = self.changed[i];
            let Some(leaf) = self.tree.leaf_node(a) else { continue };
            let mut partners = std::mem::take(&mut self.partners[a as usize]);
            let mut failed = None;
            partners.retain(|b| {
                let stays = self.tree.leaf_node(*b).is_some_and(|other| leaf.intersects(other));
                if !stays {
                    count += 1;
                    failed = remove("parry", &mut self.partners[*b as usize], [a, *b])
                        .err()
                        .or(failed.take());
                }
                stays
            });
            self.partners[a as usize] = partners;
            failed.map_or(Ok(()), Err)?;
        }
        let partners = &mut self.partners;
        let mut found = |a: u32, b: u32| {
            if !partners[a as usize].contains(&b) {
                count += 1;
                partners[a as usize].push(b);
                partners[b as usize].push(a);
            }
        };
        if self.threads > 1 {
            let pairs = self.tree.traverse_bvtt_single_tree_parallel::<true>();
            for (a, b) in pairs {
                found(a, b);
            }
        } else {
            self.tree.traverse_bvtt_single_tree::<true>(&mut self.workspace, &mut found);
        }
        Ok(count)
    }

    fn query(&mut self, moved: &[u32]) -> Result<usize, ContenderError> {
        let ask = |a: &u32| -> Vec<u32> {
            let b = &self.boxes[*a as usize];
            let there = parry_box(b, 0.0);
            let found = self.tree.intersect_aabb(&there);
            found.filter(|c| c != a && touches(b, &self.boxes[*c as usize])).collect()
        };
        let answers: Vec<Vec<u32>> = if self.threads > 1 && moved.len() >= PARALLEL_QUERIES {
            moved.par_iter().map(ask).collect()
        } else {
            moved.iter().map(ask).collect()
        };
        let mut count = 0;
        for (&a, now) in moved.iter().zip(answers) {
            // Pairs with an earlier mover of this frame stand in the list already.
            let was = std::mem::take(&mut self.partners[a as usize]);
            for &b in was.iter().filter(|b| !now.contains(b)) {
                count += 1;
                remove("parry", &mut self.partners[b as usize], [a, b])?;
            }
            for &b in now.iter().filter(|b| !was.contains(b)) {
                count += 1;
                self.partners[b as usize].push(a);
            }
            self.partners[a as usize] = now;
        }
        Ok(count)
    }

    pub fn pairs(&self) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (a, partners) in (0u32..).zip(&self.partners) {
            let here = &self.boxes[a as usize];
            let after = partners.iter().filter(|b| **b > a);
            let met = after.filter(|b| touches(here, &self.boxes[**b as usize]));
            pairs.extend(met.map(|b| [a, *b]));
        }
        pairs
    }
}
