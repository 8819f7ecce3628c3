//! Every sphere against every sphere after it: the test of Suaib et al. 2015, exact, with SIMD.

use std::ops::Range;
use std::time::Instant;

use super::Sphere;
use super::columns::BallColumns;
use super::kernel;
use crate::engine::brute_force::split;
use crate::engine::gather::Gather;
use crate::engine::strips::{WordSink, in_parts, publish};
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CullError, CullJob, CullReport, EngineName, EngineTimes, Isa, ReplyBuffer,
    SkipMeter,
};
use crate::mask::MaskShape;
use crate::units::BoxCount;

/// All pairs of spheres. Rows are shared out among threads, each with storage of its own.
///
/// Its scratch is kept from frame to frame: a steady scene on one thread allocates nothing.
///
/// ```
/// use pairmask::engine::{CullJob, HeapReply};
/// use pairmask::mask::Encoding;
/// use pairmask::sphere::{Sphere, SphereAllPairs};
///
/// let spheres = [0.0, 2.0, 5.0].map(|x| Sphere::new([x, 0.0, 0.0], 1.0));
/// let job = CullJob { encoding: Encoding::Dense, threads: 1 };
/// let mut reply = HeapReply::new();
/// let report = SphereAllPairs::new().cull(&spheres, &job, &mut reply)?;
/// assert_eq!((report.pair_count, reply.words()[0]), (1, 0b001));
/// # Ok::<(), pairmask::engine::CullError>(())
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

impl Default for SphereAllPairs {
    fn default() -> Self {
        Self::new()
    }
}

impl SphereAllPairs {
    /// The engine with the widest instruction set of this machine.
    pub fn new() -> Self {
        Self {
            isa: AvailableIsa::best(),
            columns: BallColumns::default(),
            order: Vec::new(),
            tasks: Vec::new(),
        }
    }

    /// The engine with one instruction set, for tests and measurements.
    ///
    /// # Errors
    /// [`CullError::Unavailable`] when this machine does not have it.
    pub fn with_isa(isa: Isa) -> Result<Self, CullError> {
        let isa = AvailableIsa::for_engine(isa, EngineName::CpuBrute)?;
        Ok(Self { isa, ..Self::new() })
    }

    /// Writes the pair mask of `spheres` into memory of `reply`. A sparse mask has an order, which
    /// is that of the spheres.
    ///
    /// # Errors
    /// [`CullError`]; nothing is published then.
    pub fn cull(
        &mut self,
        spheres: &[Sphere],
        job: &CullJob,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let n = counted(spheres)?;
        let budget = &WordBudget::new(n, job.encoding, true, reply)?;
        let start = Instant::now();
        let census = self.columns.ingest(spheres);
        self.order.clear();
        self.order.extend(0..n.get());
        self.assign(spheres.len(), job.threads);
        let ingested = Instant::now();

        let (columns, isa, parts) = (&self.columns, self.isa, self.tasks.len());
        let gather = &Gather { budget, test: None, order: &self.order };
        let run =
            |tasks: &mut [Task]| tasks.iter_mut().for_each(|task| task.run(columns, gather, isa));
        in_parts(self.tasks.as_mut_slice(), parts, &run, &|(), ()| ());
        let executed = Instant::now();

        let sinks = self.tasks.iter().map(|task| &task.found);
        let published = publish(sinks, gather, job.encoding, parts > 1, reply);
        let shape = published.inspect_err(|_| {
            self.tasks.iter_mut().for_each(|task| task.found.give_back());
        })?;
        let nothing = u64::from(census.empty) + u64::from(census.invalid);
        Ok(CullReport {
            shape,
            census,
            pair_count: self.tasks.iter().map(|task| task.found.pair_count()).sum(),
            skipped: SkipMeter { boxes: nothing, pairs: 0, zero_words: zero_words(n, &shape) },
            times: EngineTimes {
                ingest_ns: (ingested - start).as_nanos() as u64,
                execute_ns: (executed - ingested).as_nanos() as u64,
                publish_ns: executed.elapsed().as_nanos() as u64,
            },
        })
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
    fn run(&mut self, columns: &BallColumns, gather: &Gather<'_>, isa: AvailableIsa) {
        self.found.clear();
        for row in self.rows.clone() {
            if gather.budget.is_spent() {
                return;
            }
            kernel::search(columns, row, isa, &mut |word, bits: u64| {
                let (row, block) = (row as u32, 2 * word as u32);
                self.found.push(row, block, bits as u32, gather);
                self.found.push(row, block + 1, (bits >> 32) as u32, gather);
            });
        }
    }
}

/// The number of spheres, as every engine can index them.
pub(super) fn counted(spheres: &[Sphere]) -> Result<BoxCount, CullError> {
    let (engine, n) = (EngineName::CpuBrute, spheres.len() as u64);
    let too_many = CullError::TooManyBoxes { engine, n, limit: u64::from(u32::MAX) };
    BoxCount::of_len(spheres.len()).ok_or(too_many)
}

/// Words of a mask that are zero and were not written.
pub(super) fn zero_words(n: BoxCount, shape: &MaskShape) -> u64 {
    match shape {
        MaskShape::Dense { .. } => 0,
        MaskShape::Sparse { bits, .. } => n.sparse_words_max() - bits.len,
    }
}
