//! `cpu-grid`: a uniform grid with levels; each box looks at the cells around its home.
//!
//! The papers' grid (Avril et al. 2012, §4) lists a box in every cell that it touches. Here each
//! box has one home cell, by its min corner, in the finest level whose cells are at least as long
//! as it is; boxes are sorted by level, z, y, x of the cell, so that a cell's neighbours are a few
//! runs of positions. That neighbours are enough is proved in `axis.rs` for the very arithmetic that
//! is computed. Pairs across levels are looked for from the larger box: it visits the cells of the
//! finer levels that it covers. Work is O(n + pairs) for boxes that the sample finds a good layout for; giants
//! and infinite boxes go to levels of their own. Boxes that cells do not part are handed over to the tree: before
//! anything is sorted where the sample shows them, and else when more columns were tested than the tree would take.

mod axis;
mod bucket;
mod cell_strips;
mod cost;
mod explain;
mod far;
mod fetch;
mod homes;
mod layout;
mod level;
mod neighbours;
mod rows;
mod sample;
mod sort;
mod tile;

pub use self::explain::{GridPlace, GridView};
pub use self::far::near_bounds;
use self::layout::Layout;
pub(crate) use self::layout::{SizeClass, cell_counts, folded, size_classes};
use self::rows::{RowTask, Scene};
pub(crate) use self::sample::{Density, Sample};
use self::sort::SortedBoxes;
use crate::engine::encode;
use crate::engine::gather::Gather;
use crate::engine::strips::BLOCK_LANES;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CpuEngine, CullError, CullInput, CullReport, Engine, EngineDescriptor,
    EngineName, EnginePlace, ReplyBuffer, StageClock,
};
use crate::mask::Encoding;
use crate::precision::BoxForm;
use crate::team::{self, for_each_in_parts, part_count};

/// Fewest rows of a task: below, handing it to another thread costs more than it saves.
const TASK_ROWS: usize = 1_024;
/// Fewest boxes that are worth a second thread.
const PARALLEL_BOXES: usize = 2_048;

/// Strips a box, as the layout expects them, from which `cpu-tree` takes less time.
const STRIPS_MOST: f32 = 32.0;

/// `cpu-grid` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor {
    name: "cpu-grid",
    wire_number: 3,
    forms: &[BoxForm::F32],
    encodings: &Encoding::ALL,
    has_order: true,
    place: EnginePlace::Cpu(CpuEngine {
        make: |isa| Box::new(Grid::on(isa)),
        terms: cost::TERMS,
        work: cost::work,
    }),
};

/// The engine `cpu-grid`.
///
/// Its scratch is kept from frame to frame: a steady scene allocates nothing.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::engine::{CullInput, Engine, Grid, HeapReply};
///
/// let boxes: Vec<Aabb> = (0..1_000)
///     .map(|i| Aabb::from([i as f32, 0.0, 0.0, i as f32 + 1.0, 1.0, 1.0]))
///     .collect();
/// let mut reply = HeapReply::new();
/// let report = Grid::new().cull(&CullInput::boxes(&boxes), &mut reply)?;
/// assert_eq!(report.pair_count, 999, "each box touches the next");
/// # Ok::<(), pairmask_core::engine::CullError>(())
/// ```
pub struct Grid {
    isa: AvailableIsa,
    layout: Layout,
    sorted: SortedBoxes,
    tasks: Vec<RowTask>,
}

made_by_isa!(Grid, EngineName::CpuGrid);

impl Grid {
    /// The engine with one instruction set that this machine has.
    fn on(isa: AvailableIsa) -> Self {
        Self { isa, layout: Layout::default(), sorted: SortedBoxes::default(), tasks: Vec::new() }
    }

    /// Shares the rows out, in whole blocks, so that no block depends on how many threads there are.
    /// What overlaps nothing has no rows.
    fn assign(&mut self, threads: usize) {
        let rows = self.sorted.cell_starts[self.layout.cell_count as usize] as usize;
        let parts = part_count(rows, TASK_ROWS, threads);
        self.tasks.resize_with(parts, RowTask::default);
        for (part, task) in self.tasks.iter_mut().enumerate() {
            let border = |part: usize| match part {
                last if last == parts => rows as u32,
                _ => (rows * part / parts / BLOCK_LANES * BLOCK_LANES) as u32,
            };
            task.rows = border(part)..border(part + 1);
        }
    }
}

impl Engine for Grid {
    fn name(&self) -> EngineName {
        EngineName::CpuGrid
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, n) = input.f32_boxes(EngineName::CpuGrid)?;
        let budget = WordBudget::new(n, input.encoding, true, reply)?;
        let budget = &budget.handing_over(EngineName::CpuGrid, input.may_hand_over);
        let threads = if boxes.len() < PARALLEL_BOXES { 1 } else { input.threads.max(1) };
        let _team = team::enter(threads);
        let mut clock = StageClock::start();
        self.layout.choose(boxes);
        if input.may_hand_over && self.layout.cost > STRIPS_MOST {
            return Err(CullError::TooCrowded { engine: EngineName::CpuGrid });
        }
        let levels = self.layout.levels.as_slice();
        let census = self.sorted.sort(boxes, levels, self.layout.cell_count, threads, self.isa);
        clock.ingested();

        self.assign(threads);
        let (order, isa) = (self.sorted.boxes.order(), self.isa);
        input.rules.prepare(boxes.len(), order, threads);
        let gather = &Gather { budget, rules: input.rules, order, isa };
        let levels = &self.layout.levels;
        let scene = Scene { sorted: &self.sorted, levels, gather };
        let parts = self.tasks.len();
        for_each_in_parts(&mut self.tasks, parts, |task| task.run(scene));
        clock.executed();

        let sinks = self.tasks.iter().map(|task| &task.found);
        let published = encode::write(sinks, gather, input.encoding, threads > 1, reply);
        let shape = published.inspect_err(|_| {
            self.tasks.iter_mut().for_each(|task| task.found.give_back());
        })?;
        let pair_count = self.tasks.iter().map(|task| task.found.pair_count()).sum();
        let compared = self.tasks.iter().map(|task| task.compared).sum();
        Ok(CullReport::new(n, shape, census, pair_count, compared, clock.published()))
    }

    fn scratch_bytes(&self) -> usize {
        self.sorted.allocated_bytes()
            + self.tasks.iter().map(RowTask::allocated_bytes).sum::<usize>()
    }

    fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }
}
