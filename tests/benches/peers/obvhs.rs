//! obvhs's two-way hierarchy, traversed against itself.
//!
//! The library has only box queries. One query a leaf takes three times as long as this traversal
//! over its public nodes, which a user who needs all pairs would write.

use glam::Vec3A;
use obvhs::aabb::Aabb as ObvhsBox;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use pairmask_core::Aabb;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use pairmask_tests::oracle::Pair;
use pairmask_tests::peers::contender::{Contender, ContenderError, Tally};

/// Tasks that the traversal is cut into on several threads: enough that none is long.
const TASKS: usize = 256;

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
            upkeep,
            threads,
        };
        // A tree that is kept is built better than one for a single frame.
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

    /// Visits a task if it is a pair of leaves, else calls `go_on` with the tasks that it consists of.
    #[inline(always)]
    fn step(&self, task: Task, visit: &mut impl FnMut(u32, u32), mut go_on: impl FnMut(Task)) {
        let Task(a, b) = task;
        let [p, q] = [a, b].map(|node| &self.tree.nodes[node as usize]);
        if a == b {
            if !p.is_leaf() {
                let left = p.first_index;
                go_on(Task(left, left));
                go_on(Task(left + 1, left + 1));
                go_on(Task(left, left + 1));
            }
        } else if p.aabb().intersect_aabb(q.aabb()) {
            match (p.is_leaf(), q.is_leaf()) {
                (true, true) => {
                    let index =
                        |node: &Bvh2Node| self.tree.primitive_indices[node.first_index as usize];
                    visit(index(p), index(q));
                }
                (false, true) => (0..2).for_each(|i| go_on(Task(p.first_index + i, b))),
                (true, false) => (0..2).for_each(|i| go_on(Task(a, q.first_index + i))),
                (false, false) => {
                    for i in 0..2 {
                        (0..2).for_each(|j| go_on(Task(p.first_index + i, q.first_index + j)));
                    }
                }
            }
        }
    }

    /// Calls `visit` for each pair below a task.
    fn traverse(&self, task: Task, visit: &mut impl FnMut(u32, u32)) {
        let mut stack = vec![task];
        while let Some(task) = stack.pop() {
            self.step(task, visit, |task| stack.push(task));
        }
    }

    fn tally(&self, task: Task) -> Tally {
        let mut tally = Tally::default();
        self.traverse(task, &mut |a, b| tally.visit(a, b));
        tally
    }

    /// The root's task cut into many, and the pairs met while cutting.
    fn cut(&self) -> (Vec<Task>, Tally) {
        let mut tally = Tally::default();
        let mut tasks = vec![ROOT];
        while (1..TASKS).contains(&tasks.len()) {
            let mut finer = Vec::with_capacity(4 * tasks.len());
            for task in tasks {
                self.step(task, &mut |a, b| tally.visit(a, b), |task| finer.push(task));
            }
            tasks = finer;
        }
        (tasks, tally)
    }
}

/// Two nodes whose leaves are paired; the same node twice stands for the pairs within it.
#[derive(Clone, Copy)]
struct Task(u32, u32);

const ROOT: Task = Task(0, 0);

impl Contender for Obvhs {
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError> {
        self.follow(boxes);
        if self.tree.nodes.is_empty() {
            return Ok(Tally::default());
        }
        if self.threads > 1 {
            let (tasks, met) = self.cut();
            let below = tasks.par_iter().map(|task| self.tally(*task));
            Ok(met.plus(below.reduce(Tally::default, Tally::plus)))
        } else {
            Ok(self.tally(ROOT))
        }
    }

    fn pairs(&mut self, _: &[Aabb]) -> Result<Vec<Pair>, ContenderError> {
        let mut pairs = Vec::new();
        if !self.tree.nodes.is_empty() {
            self.traverse(ROOT, &mut |a, b| pairs.push((a, b)));
        }
        Ok(pairs)
    }
}
