//! Every sphere against every sphere after it: the test of Suaib et al. 2015, exact, with SIMD.

use std::ops::Range;

use super::Sphere;
use super::columns::BallColumns;
use super::kernel;
use crate::engine::brute_force::split;
use crate::engine::encode;
use crate::engine::gather::Gather;
use crate::engine::strips::WordSink;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CullError, CullInput, CullReport, EngineName, ReplyBuffer, StageClock, counted,
    made_by_isa,
};
use crate::team;
use crate::team::for_each_in_parts;

/// All pairs of spheres. Rows are shared out among threads, each with storage of its own.
///
/// Its scratch is kept from frame to frame: a steady scene on one thread allocates nothing.
///
/// ```
/// use pairmask_core::engine::{CullInput, HeapReply};
/// use pairmask_core::mask::Encoding;
/// use pairmask_core::sphere::{Sphere, SphereAllPairs};
///
/// let spheres = [0.0, 2.0, 5.0].map(|x| Sphere::new([x, 0.0, 0.0], 1.0));
/// let input = CullInput::spheres(&spheres).encoding(Encoding::Dense);
/// let mut reply = HeapReply::new();
/// let report = SphereAllPairs::new().cull(&input, &mut reply)?;
/// assert_eq!((report.pair_count, reply.words()[0]), (1, 0b001));
/// # Ok::<(), pairmask_core::engine::CullError>(())
/// ```
pub struct SphereAllPairs {
    isa: AvailableIsa,
    columns: BallColumns,
    order: Vec<u32>,
    tasks: Vec<Task>,
}

/// Rows of one thread's turn.
#[derive(Default)]
struct Task {
    rows: Range<usize>,
    found: WordSink,
}

impl<'a> CullInput<'a, &'a [Sphere]> {
    /// Spheres, with what [`CullInput::boxes`] has for the rest.
    pub const fn spheres(spheres: &'a [Sphere]) -> Self {
        Self::of(spheres)
    }
}

made_by_isa!(SphereAllPairs, EngineName::CpuBrute);

impl SphereAllPairs {
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
        let is_shared = split::task_count(spheres.len(), input.threads) > 1;
        let _team = team::enter(if is_shared { input.threads } else { 1 });
        let mut clock = StageClock::start();
        let census = self.columns.ingest(spheres);
        self.order.clear();
        self.order.extend(0..n.get());
        self.assign(spheres.len(), input.threads);
        clock.ingested();

        let (columns, isa, parts) = (&self.columns, self.isa, self.tasks.len());
        let gather = &Gather { budget, rules: input.rules, order: &self.order, isa };
        for_each_in_parts(&mut self.tasks, parts, |task| task.run(columns, gather));
        clock.executed();

        let sinks = self.tasks.iter().map(|task| &task.found);
        let published = encode::write(sinks, gather, input.encoding, parts > 1, reply);
        let shape = published.inspect_err(|_| {
            self.tasks.iter_mut().for_each(|task| task.found.give_back());
        })?;
        let pair_count = self.tasks.iter().map(|task| task.found.pair_count()).sum();
        Ok(CullReport::new(n, shape, census, pair_count, n.pair_count(), clock.published()))
    }

    /// Bytes of scratch that the engine keeps from frame to frame, beside spheres and reply.
    pub fn scratch_bytes(&self) -> usize {
        self.columns.allocated_bytes()
            + self.order.capacity() * size_of::<u32>()
            + self.tasks.iter().map(|task| task.found.allocated_bytes()).sum::<usize>()
    }

    fn assign(&mut self, n: usize, threads: usize) {
        let parts = split::task_count(n, threads);
        self.tasks.resize_with(parts, Task::default);
        for (part, task) in self.tasks.iter_mut().enumerate() {
            task.rows = split::first_row(part, parts, n)..split::first_row(part + 1, parts, n);
        }
    }
}

impl Task {
    /// Finds the words of all rows, until the budget is spent.
    fn run(&mut self, columns: &BallColumns, gather: &Gather<'_>) {
        self.found.clear();
        for row in self.rows.clone() {
            if gather.budget.is_spent() {
                return;
            }
            kernel::search(columns, row, gather.isa, &mut |word, bits: u64| {
                let (row, block) = (row as u32, 2 * word as u32);
                self.found.push(row, block, bits as u32, gather);
                self.found.push(row, block + 1, (bits >> 32) as u32, gather);
            });
        }
        self.found.finish(gather);
    }
}
