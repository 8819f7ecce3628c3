//! `cpu-tree`: a tree of boxes, for scenes that cells do not part.
//!
//! A grid is quick where boxes are of a few sizes and evenly spread. Long boxes that cross, as the wires of
//! a chip, sizes over many decades in one place, or a crowd in one corner of a huge world leave it with cells
//! that hold everything. The tree has no such scene: boxes are brought into an order in which each 16 lie
//! close together, and so do each 16 of those groups, up to the whole. The order is the tree. Each group has
//! its bounds, and a box is compared with the groups behind its own that it meets, 16 at a time.
//!
//! Groups are parted by the surface area heuristic of ray tracing (Goldsmith and Salmon 1987), with the
//! expected number of boxes that meet a group in place of its surface: of its own boxes, and of those around it, of
//! which a sample goes down with the cuts. They are parted by size as well as by place, so that rods of three
//! directions, or giants among pebbles, part too.

mod arrange;
mod cost;
mod cut;
mod divide;
mod nodes;
mod search;

use self::arrange::{Entry, arrange};
use self::cut::Surroundings;
use self::nodes::Nodes;
use self::search::Lists;
use crate::aabb::Aabb;
use crate::aligned::AlignedBuffer;
use crate::cancel::Cancel;
use crate::engine::gather::Gather;
use crate::engine::ordered::{Arrangement, Ordered};
use crate::engine::strips::{OrderedBoxes, STRIP_COLUMNS, StripTask};
use crate::engine::{AvailableIsa, Census, CpuEngine, CullError, EngineDescriptor, EngineName};
use crate::team::part_count;

/// Boxes, or groups, of a group: what one strip holds.
const FAN_OUT: usize = STRIP_COLUMNS;

/// `cpu-tree` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor::of_cpu(
    "cpu-tree",
    6,
    true,
    CpuEngine { make: |isa| Box::new(Tree::on(isa)), terms: cost::TERMS },
);

/// The engine `cpu-tree`.
type Tree = Ordered<Groups>;

/// Boxes in groups.
#[derive(Default)]
pub(super) struct Groups {
    entries: AlignedBuffer<Entry>,
    keys: AlignedBuffer<i32>,
    boxes: OrderedBoxes,
    nodes: Nodes,
}

/// Brings boxes into the order of the tree, and those that overlap nothing behind all others, unless cancelled.
fn order_into(
    (entries, keys): (&mut AlignedBuffer<Entry>, &mut AlignedBuffer<i32>),
    boxes: &[Aabb],
    threads: usize,
    isa: AvailableIsa,
    cancel: &Cancel,
) -> Census {
    entries.resize(boxes.len());
    keys.resize(boxes.len());
    let entries = entries.as_mut_slice();
    let census = arrange::read(boxes, entries, threads);
    let valid = arrange::valid_first(entries, &census);
    let parts = part_count(valid.len(), arrange::TASK_BOXES, threads);
    let keys = &mut keys.as_mut_slice()[..valid.len()];
    arrange(valid, keys, &Surroundings::default(), parts, isa, cancel);
    census
}

/// Boxes in an order in which each 16 lie close together, and so do each 16 of those groups, up to the whole;
/// cancelled, in any order.
pub(crate) fn order_by_tree(
    boxes: &[Aabb],
    threads: usize,
    isa: AvailableIsa,
    cancel: &Cancel,
) -> AlignedBuffer<Entry> {
    let mut entries = AlignedBuffer::default();
    order_into((&mut entries, &mut AlignedBuffer::default()), boxes, threads, isa, cancel);
    entries
}

impl Arrangement for Groups {
    const NAME: EngineName = EngineName::CpuTree;
    const PARALLEL_BOXES: usize = 1_024;
    const TASK_ROWS: usize = 32 * FAN_OUT;
    const HANDS_OVER: bool = false;
    const HAS_CELLS: bool = false;

    type Own = Lists;

    fn arrange(
        &mut self,
        boxes: &[Aabb],
        threads: usize,
        _may_hand_over: bool,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Result<Census, CullError> {
        let census = order_into((&mut self.entries, &mut self.keys), boxes, threads, isa, cancel);
        if cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        self.boxes.resize(boxes.len());
        self.nodes.build(self.entries.as_slice(), &mut self.boxes, threads);
        Ok(census)
    }

    fn boxes(&self) -> &OrderedBoxes {
        &self.boxes
    }

    fn search(&self, task: &mut StripTask<Lists>, valid: u32, gather: &Gather<'_>) {
        task.search(&self.boxes, &self.nodes, valid, gather);
    }

    fn own_bytes(own: &Lists) -> usize {
        own.allocated_bytes()
    }

    fn allocated_bytes(&self) -> usize {
        self.entries.allocated_bytes()
            + self.keys.allocated_bytes()
            + self.boxes.allocated_bytes()
            + self.nodes.allocated_bytes()
    }
}
