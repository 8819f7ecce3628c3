//! `cpu-tree`: a tree of boxes, for scenes that cells do not part.
//!
//! A grid is quick where boxes are of a few sizes and evenly spread. Long boxes that cross, as the wires of
//! a chip, sizes over many decades in one place, or a crowd in one corner of a huge world leave it with cells
//! that hold everything. The tree has no such scene: boxes are brought into an order in which each 16 lie
//! close together, and so do each 16 of those groups, up to the whole. The order is the tree. Each group has
//! its bounds, and a box is compared with the groups behind its own that it meets, 16 at a time.
//!
//! Groups are parted by the surface area heuristic of ray tracing (Goldsmith and Salmon 1987), with the
//! expected number of boxes that meet a group in place of its surface, and by size as well as by place, so
//! that rods of three directions, or giants among pebbles, part too.

mod arrange;
mod cost;
mod cut;
mod nodes;
mod search;

use self::arrange::{Entry, arrange};
use self::cut::Meeting;
use self::nodes::Nodes;
use self::search::SearchTask;
use crate::aabb::Aabb;
use crate::aligned::AlignedBuffer;
use crate::engine::encode;
use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, STRIP_COLUMNS};
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, Census, CpuEngine, CullError, CullInput, CullReport, Engine, EngineDescriptor,
    EngineName, EnginePlace, ReplyBuffer, StageClock,
};
use crate::floats;
use crate::mask::Encoding;
use crate::precision::BoxForm;
use crate::team::{self, for_each_in_parts, part_count};

/// Boxes, or groups, of a group: what one strip holds.
const FAN_OUT: usize = STRIP_COLUMNS;
/// Fewest groups of 16 rows of a task: below, handing it to another thread costs more than it saves.
const TASK_GROUPS: usize = 32;
/// Fewest boxes that are worth a second thread.
const PARALLEL_BOXES: usize = 1_024;

/// `cpu-tree` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor {
    name: "cpu-tree",
    wire_number: 6,
    forms: &[BoxForm::F32],
    encodings: &Encoding::ALL,
    has_order: true,
    place: EnginePlace::Cpu(CpuEngine {
        make: |isa| Box::new(Tree::on(isa)),
        terms: cost::TERMS,
        work: cost::work,
    }),
};

/// The engine `cpu-tree`.
///
/// Its scratch is kept from frame to frame.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::engine::{CullInput, Engine, HeapReply, Tree};
///
/// // A hundred long boxes along x, and as many along y that cross them all.
/// let along = |i: f32| Aabb::from([0.0, i, 0.0, 100.0, i + 0.5, 1.0]);
/// let across = |i: f32| Aabb::from([i, 0.0, 0.0, i + 0.5, 100.0, 1.0]);
/// let boxes: Vec<Aabb> = (0..100).flat_map(|i| [along(i as f32), across(i as f32)]).collect();
/// let mut reply = HeapReply::new();
/// let report = Tree::new().cull(&CullInput::boxes(&boxes), &mut reply)?;
/// assert_eq!(report.pair_count, 10_000);
/// # Ok::<(), pairmask_core::engine::CullError>(())
/// ```
pub struct Tree {
    isa: AvailableIsa,
    entries: AlignedBuffer<Entry>,
    boxes: OrderedBoxes,
    nodes: Nodes,
    tasks: Vec<SearchTask>,
}

made_by_isa!(Tree, EngineName::CpuTree);

impl Tree {
    /// The engine with one instruction set that this machine has.
    fn on(isa: AvailableIsa) -> Self {
        Self {
            isa,
            entries: AlignedBuffer::default(),
            boxes: OrderedBoxes::default(),
            nodes: Nodes::default(),
            tasks: Vec::new(),
        }
    }

    /// Reads the boxes and builds the tree.
    fn build(&mut self, boxes: &[Aabb], threads: usize) -> Census {
        self.entries.resize(boxes.len());
        let entries = self.entries.as_mut_slice();
        let census = arrange::read(boxes, entries, threads);
        let solid = arrange::solid_first(entries, &census);
        let meeting = floats::with_default(|| Meeting::of(solid));
        let parts = part_count(solid.len(), arrange::TASK_BOXES, threads);
        arrange(solid, &meeting, parts, self.isa);
        self.boxes.resize(boxes.len());
        self.nodes.build(self.entries.as_slice(), &mut self.boxes, threads);
        census
    }

    /// Shares the groups of rows out. What overlaps nothing stands last and has no rows.
    fn assign(&mut self, rows: usize, threads: usize) {
        let groups = rows.div_ceil(FAN_OUT);
        let parts = part_count(groups, TASK_GROUPS, threads);
        self.tasks.resize_with(parts, SearchTask::default);
        for (part, task) in self.tasks.iter_mut().enumerate() {
            let border = |part: usize| (groups * part / parts) as u32;
            task.groups = border(part)..border(part + 1);
        }
    }
}

impl Engine for Tree {
    fn name(&self) -> EngineName {
        EngineName::CpuTree
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, n) = input.f32_boxes(EngineName::CpuTree)?;
        let budget = &WordBudget::new(n, input.encoding, true, reply)?;
        let threads = if boxes.len() < PARALLEL_BOXES { 1 } else { input.threads.max(1) };
        let _team = team::enter(threads);
        let mut clock = StageClock::start();
        let census = self.build(boxes, threads);
        let solid = boxes.len() - (census.empty + census.invalid) as usize;
        clock.ingested();

        self.assign(solid, threads);
        let (isa, parts) = (self.isa, self.tasks.len());
        let order = self.boxes.order();
        input.rules.prepare(boxes.len(), order, threads);
        let gather = Gather { budget, rules: input.rules, order, isa };
        let (ordered, nodes) = (&self.boxes, &self.nodes);
        let run = |task: &mut SearchTask| task.run(ordered, nodes, solid as u32, &gather);
        for_each_in_parts(&mut self.tasks, parts, run);
        clock.executed();

        let sinks = self.tasks.iter().map(|task| &task.found);
        let published = encode::write(sinks, &gather, input.encoding, threads > 1, reply);
        let shape = published.inspect_err(|_| {
            self.tasks.iter_mut().for_each(|task| task.found.give_back());
        })?;
        let pair_count = self.tasks.iter().map(|task| task.found.pair_count()).sum();
        let compared = self.tasks.iter().map(|task| task.compared).sum();
        let times = clock.published();
        Ok(CullReport::new(n, shape, census, pair_count, compared, times).apart_on_axes())
    }

    fn scratch_bytes(&self) -> usize {
        self.entries.allocated_bytes()
            + self.boxes.allocated_bytes()
            + self.nodes.allocated_bytes()
            + self.tasks.iter().map(SearchTask::allocated_bytes).sum::<usize>()
    }

    fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }
}
