//! Every sphere against every sphere after it: the test of Suaib et al. 2015, exact, with SIMD.

use super::Sphere;
use super::columns::BallColumns;
use super::kernel;
use crate::engine::brute_force::split;
use crate::engine::gather::Gather;
use crate::engine::strips::StripTask;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CullError, CullInput, CullReport, EngineName, Isa, ReplyBuffer, StageClock,
    available, counted, publish,
};
use crate::team::{self, for_each_in_parts};

/// All pairs of spheres. Rows are shared out among threads, each with storage of its own.
///
/// Its scratch is kept from frame to frame: a steady scene on one thread allocates nothing.
pub struct SphereAllPairs {
    isa: AvailableIsa,
    columns: BallColumns,
    order: Vec<u32>,
    tasks: Vec<StripTask>,
}

impl<'a> CullInput<'a, &'a [Sphere]> {
    /// Spheres, with what [`CullInput::boxes`] has for the rest.
    pub const fn spheres(spheres: &'a [Sphere]) -> Self {
        Self::of(spheres)
    }
}

impl Default for SphereAllPairs {
    fn default() -> Self {
        Self::new()
    }
}

impl SphereAllPairs {
    /// The engine with the widest instruction set of this machine.
    pub fn new() -> Self {
        Self::on(AvailableIsa::best())
    }

    /// The engine with one instruction set, for tests and measurements.
    ///
    /// # Errors
    /// [`CullError::Unavailable`] when this machine does not have it.
    pub fn with_isa(isa: Isa) -> Result<Self, CullError> {
        available(isa, EngineName::CpuBrute).map(Self::on)
    }

    /// The engine with one instruction set that this machine has.
    pub(crate) fn on(isa: AvailableIsa) -> Self {
        Self { isa, columns: BallColumns::default(), order: Vec::new(), tasks: Vec::new() }
    }

    /// Writes the pair mask of `spheres` into memory of `reply`. A sparse mask has an order, which
    /// is that of the spheres.
    ///
    /// # Errors
    /// [`CullError`]; nothing is published then.
    pub fn cull(
        &mut self,
        input: &CullInput<'_, &[Sphere]>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let spheres = input.objects;
        let n = counted(spheres, EngineName::CpuBrute)?;
        let budget = &WordBudget::new(n, input.encoding, true, reply)?;
        if input.rules.pass_all() {
            budget.look_at(|index| spheres.get(index).copied(), None)?;
        }
        let threads = split::threads_for(spheres.len(), input.threads);
        let _team = team::enter(threads);
        let mut clock = StageClock::start();
        let census = self.columns.ingest(spheres, budget.cancel())?;
        self.order.clear();
        self.order.extend(0..n.get());
        let ranges = split::ranges(spheres.len(), threads);
        self.tasks.resize_with(ranges.len(), StripTask::default);
        for (task, rows) in self.tasks.iter_mut().zip(ranges) {
            task.rows = rows.start as u32..rows.end as u32;
        }
        clock.ingested();

        let (columns, isa, parts) = (&self.columns, self.isa, self.tasks.len());
        let gather = &Gather { budget, rules: input.rules, order: &self.order, isa, keeps: true };
        for_each_in_parts(&mut self.tasks, parts, |task| find(task, columns, gather));
        clock.executed();

        let is_shared = parts > 1;
        let (shape, pairs) = publish(&mut self.tasks, gather, input.encoding, is_shared, reply)?;
        Ok(CullReport::new(n, shape, census, pairs, n.pair_count(), clock.published()))
    }

    /// Bytes of scratch that the engine keeps from frame to frame, beside spheres and reply.
    pub fn scratch_bytes(&self) -> usize {
        self.columns.allocated_bytes()
            + self.order.capacity() * size_of::<u32>()
            + self.tasks.iter().map(StripTask::allocated_bytes).sum::<usize>()
    }
}

/// Finds the words of all rows, until the budget is spent.
fn find(task: &mut StripTask, columns: &BallColumns, gather: &Gather<'_>) {
    task.begin();
    for row in task.rows.clone() {
        let before = task.found.pair_count();
        if gather.budget.is_spent() {
            return;
        }
        kernel::search(columns, row as usize, gather.isa, &mut |word, bits: u64| {
            let block = 2 * word as u32;
            task.found.push(row, block, bits as u32, gather);
            task.found.push(row, block + 1, (bits >> 32) as u32, gather);
        });
        let pairs = task.found.pair_count().saturating_sub(before);
        task.found.note_tests((columns.len() - row as usize) as u64, pairs, gather);
    }
    task.found.finish(gather);
}
