//! `cpu-sap`: sweep and prune on several cores.
//!
//! Avril, Gouranton and Arnaldi 2009 (§5.1) and 2014 (§4): boxes shared out among threads, each
//! with storage of its own, merged without locks. The papers compare all pairs; here boxes are
//! sorted along the axis of widest spread (Cohen et al. 1995) and a row is compared with the
//! window after it, 16 columns a step. Giants cost their own window and nothing more, which makes
//! this the engine for scenes of few boxes of very unlike shapes.

mod axis;
mod cost;
mod order;
mod sweep;

use self::order::SweepOrder;
use self::sweep::SweepTask;
use crate::aabb::Aabb;
use crate::engine::encode;
use crate::engine::gather::Gather;
use crate::engine::strips::OrderedBoxes;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, Census, CpuEngine, CullError, CullInput, CullReport, Engine, EngineDescriptor,
    EngineName, EnginePlace, KeyColumns, ReplyBuffer, StageClock,
};
use crate::mask::Encoding;
use crate::precision::BoxForm;
use crate::team::{self, for_each_in_parts, part_count};

/// Fewest rows of a task: below, handing it to another thread costs more than it saves.
const TASK_ROWS: usize = 512;
/// Fewest boxes that are worth a second thread.
const PARALLEL_BOXES: usize = 1_024;

/// `cpu-sap` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor {
    name: "cpu-sap",
    wire_number: 2,
    forms: &[BoxForm::F32],
    encodings: &Encoding::ALL,
    has_order: true,
    place: EnginePlace::Cpu(CpuEngine {
        make: |isa| Box::new(SweepAndPrune::on(isa)),
        terms: cost::TERMS,
        work: cost::work,
    }),
};

/// The engine `cpu-sap`.
///
/// Its scratch and its order are kept from frame to frame: a steady scene allocates nothing.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::engine::{CullInput, Engine, HeapReply, SweepAndPrune};
///
/// let boxes: Vec<Aabb> = (0..100)
///     .map(|i| Aabb::from([i as f32, 0.0, 0.0, i as f32 + 1.0, 1.0, 1.0]))
///     .collect();
/// let mut reply = HeapReply::new();
/// let report = SweepAndPrune::new().cull(&CullInput::boxes(&boxes), &mut reply)?;
/// assert_eq!(report.pair_count, 99, "each box touches the next");
/// # Ok::<(), pairmask_core::engine::CullError>(())
/// ```
pub struct SweepAndPrune {
    isa: AvailableIsa,
    columns: KeyColumns,
    order: SweepOrder,
    boxes: OrderedBoxes,
    tasks: Vec<SweepTask>,
}

made_by_isa!(SweepAndPrune, EngineName::CpuSap);

impl SweepAndPrune {
    /// The engine with one instruction set that this machine has.
    fn on(isa: AvailableIsa) -> Self {
        Self {
            isa,
            columns: KeyColumns::default(),
            order: SweepOrder::default(),
            boxes: OrderedBoxes::default(),
            tasks: Vec::new(),
        }
    }

    /// Reads and sorts the boxes; returns the sweep axis.
    fn ingest(&mut self, boxes: &[Aabb]) -> (Census, usize) {
        let census = self.columns.ingest(boxes, self.isa);
        let axis = axis::widest(&self.columns);
        let n = boxes.len();
        self.order.sort(&self.columns.min(axis)[..n]);
        self.boxes.resize(n);
        let (keys, order) = self.boxes.parts_mut();
        for (slot, index) in order.iter_mut().zip(self.order.indices()) {
            *slot = index;
        }
        for (component, array) in keys.into_iter().enumerate() {
            let axis = component % 3;
            let of = if component < 3 { self.columns.min(axis) } else { self.columns.max(axis) };
            for (key, index) in array.iter_mut().zip(&*order) {
                *key = of[*index as usize];
            }
        }
        (census, axis)
    }

    /// Shares the rows out. What overlaps nothing stands last and has no rows.
    fn assign(&mut self, rows: usize, threads: usize) {
        let parts = part_count(rows, TASK_ROWS, threads);
        self.tasks.resize_with(parts, SweepTask::default);
        for (part, task) in self.tasks.iter_mut().enumerate() {
            let border = |part: usize| (rows * part / parts) as u32;
            task.rows = border(part)..border(part + 1);
        }
    }
}

impl Engine for SweepAndPrune {
    fn name(&self) -> EngineName {
        EngineName::CpuSap
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, n) = input.f32_boxes(EngineName::CpuSap)?;
        let budget = WordBudget::new(n, input.encoding, true, reply)?;
        let budget = &budget.handing_over(EngineName::CpuSap, input.may_hand_over);
        let threads = if boxes.len() < PARALLEL_BOXES { 1 } else { input.threads.max(1) };
        let _team = team::enter(threads);
        let mut clock = StageClock::start();
        let (census, axis) = self.ingest(boxes);
        let solid = boxes.len() - (census.empty + census.invalid) as usize;
        clock.ingested();

        self.assign(solid, threads);
        let (ordered, isa, parts) = (&self.boxes, self.isa, self.tasks.len());
        let order = ordered.order();
        input.rules.prepare(boxes.len(), order, threads);
        let gather = Gather { budget, rules: input.rules, order, isa };
        let run = |task: &mut SweepTask| task.run(ordered, &gather, axis, solid as u32);
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
        self.columns.allocated_bytes()
            + self.order.allocated_bytes()
            + self.boxes.allocated_bytes()
            + self.tasks.iter().map(SweepTask::allocated_bytes).sum::<usize>()
    }

    fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }
}
