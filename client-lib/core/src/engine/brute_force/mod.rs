//! `cpu-brute`: every box against every box after it, with SIMD. The compare mask *is* the output.
//!
//! The all-pairs test of Avril, Gouranton and Arnaldi 2009 (§3) with rows shared out among threads,
//! each with its own storage, and no shared writes. The stages of a frame:
//!
//! ```text
//! ingest      boxes → keys, one array a coordinate            (engine::ingest)
//! build       keys → buckets → bit strings; corners           (quantiles, bitmaps, corners)
//! find        row's strings under AND → candidates → words    (search, candidates, words)
//! publish     words → a mask, as they are found or at the end  (engine::encode)
//! ```
//!
//! Below `BITMAP_BOXES` there are no bitmaps: every row is compared with every column at once. A
//! kernel (avx512, avx2, neon, portable) is what an instruction set does in its own way; the loops
//! around it are the same for all.
//!
//! Bytes do not depend on threads or kernels: sparse words are the non-zero words of the matrix in
//! its order, and a dense word has one writer. The skip meter counts a pair as left out when its
//! keys were never compared, which is what the bitmaps are for.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod bitmaps;
mod candidates;
mod corners;
mod cost;
mod dispatch;
mod fan_out;
mod kernel;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;
mod quantiles;
mod search;
pub(crate) mod split;
mod task;
mod words;

use self::bitmaps::Bitmaps;
use self::search::Scene;
use self::task::Task;
use crate::engine::encode::{self, DenseRows};
use crate::engine::gather::Gather;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CpuEngine, CullError, CullInput, CullReport, Engine, EngineDescriptor,
    EngineName, EnginePlace, Isa, KeyColumns, ReplyBuffer, StageClock, available,
};
use crate::mask::{Encoding, MaskShape};
use crate::precision::BoxForm;

/// Fewest boxes for which bitmaps take less time to build than they save.
const BITMAP_BOXES: usize = 192;

/// `cpu-brute` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor {
    name: "cpu-brute",
    wire_number: 1,
    since_minor: 0,
    forms: &[BoxForm::F32],
    encodings: &Encoding::ALL,
    has_order: false,
    place: EnginePlace::Cpu(CpuEngine {
        make: |isa| Box::new(BruteForce::on(isa)),
        terms: cost::TERMS,
        work: cost::work,
    }),
};

/// The engine `cpu-brute`. Fastest for tiny scenes, and the reference for the others.
///
/// Its scratch is kept from frame to frame: a steady scene on one thread allocates nothing.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::engine::{BruteForce, CullInput, Engine, HeapReply};
/// use pairmask_core::mask::Encoding;
///
/// let boxes = [
///     Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
///     Aabb::from([5.0, 0.0, 0.0, 6.0, 1.0, 1.0]),
///     Aabb::from([1.0, 0.0, 0.0, 2.0, 1.0, 1.0]),
/// ];
/// let mut reply = HeapReply::new();
/// let input = CullInput::boxes(&boxes).encoding(Encoding::Dense);
/// let report = BruteForce::new().cull(&input, &mut reply)?;
/// assert_eq!(report.pair_count, 1);
/// assert_eq!(reply.words(), [0b010], "pair 1 is (0, 2)");
/// # Ok::<(), pairmask_core::engine::CullError>(())
/// ```
pub struct BruteForce {
    isa: AvailableIsa,
    columns: KeyColumns,
    bitmaps: Bitmaps,
    tasks: Vec<Task>,
}

impl Default for BruteForce {
    fn default() -> Self {
        Self::new()
    }
}

impl BruteForce {
    /// The engine with the widest instruction set of this machine.
    pub fn new() -> Self {
        Self::on(AvailableIsa::best())
    }

    /// The engine with one instruction set that this machine has.
    fn on(isa: AvailableIsa) -> Self {
        Self { isa, columns: KeyColumns::default(), bitmaps: Bitmaps::default(), tasks: Vec::new() }
    }

    /// The engine with one instruction set, for tests and measurements.
    ///
    /// # Errors
    /// [`CullError::Unavailable`] when this machine does not have it.
    pub fn with_isa(isa: Isa) -> Result<Self, CullError> {
        available(isa, EngineName::CpuBrute).map(Self::on)
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa.get()
    }

    /// Shares the rows out, one range a task.
    fn assign(&mut self, threads: usize) {
        let n = self.columns.len();
        let parts = split::task_count(n, threads);
        self.tasks.resize_with(parts, Task::default);
        for (part, task) in self.tasks.iter_mut().enumerate() {
            task.assign(split::first_row(part, parts, n)..split::first_row(part + 1, parts, n));
        }
    }

    /// Finds all words and writes them, while they are found where the encoding allows it.
    fn publish(
        &mut self,
        gather: &Gather<'_>,
        encoding: Encoding,
        clock: &mut StageClock,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<MaskShape, CullError> {
        if let Some(mask) = encode::by_rows(encoding, gather.budget.n(), reply)? {
            return Ok(self.run_into(mask, gather, clock));
        }
        self.run(gather, encoding, clock, reply)
    }

    /// Finds all words and has them written.
    fn run(
        &mut self,
        gather: &Gather<'_>,
        encoding: Encoding,
        clock: &mut StageClock,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<MaskShape, CullError> {
        let (scene, isa) = (scene(&self.columns, &self.bitmaps), self.isa);
        fan_out::for_each(&mut self.tasks, &|task| task.run(&scene, gather, isa));
        clock.executed();
        encode::write(self.tasks.iter().map(Task::found), gather, encoding, false, reply)
    }

    /// Writes the words of each task where they belong, as they are found.
    fn run_into(
        &mut self,
        mut mask: DenseRows<'_>,
        gather: &Gather<'_>,
        clock: &mut StageClock,
    ) -> MaskShape {
        let (scene, isa) = (scene(&self.columns, &self.bitmaps), self.isa);
        fan_out::for_each_window(&mut self.tasks, mask.window(), &|task, window| {
            task.run_into(&scene, gather, isa, window);
        });
        clock.executed();
        for task in &self.tasks {
            mask.add_carry(task.rows().end, task.carry);
        }
        mask.shape()
    }
}

/// What the tasks search in.
fn scene<'a>(columns: &'a KeyColumns, bitmaps: &'a Bitmaps) -> Scene<'a> {
    let n = columns.len();
    let bitmaps = (n >= BITMAP_BOXES).then_some(bitmaps);
    Scene { columns: columns.words(), n, bitmaps }
}

impl Engine for BruteForce {
    fn name(&self) -> EngineName {
        EngineName::CpuBrute
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, n) = input.f32_boxes(EngineName::CpuBrute)?;
        let budget = &WordBudget::new(n, input.encoding, false, reply)?;
        let gather = &Gather { budget, rules: input.rules, order: &[], isa: self.isa };
        let mut clock = StageClock::start();
        let census = self.columns.ingest(boxes, self.isa);
        if boxes.len() >= BITMAP_BOXES {
            dispatch::build(&mut self.bitmaps, &self.columns.words(), boxes.len(), self.isa);
        }
        self.assign(input.threads);
        input.rules.prepare(boxes.len(), &[], input.threads);
        clock.ingested();
        let published = self.publish(gather, input.encoding, &mut clock, reply);
        let shape = published.inspect_err(|_| self.tasks.iter_mut().for_each(Task::give_back))?;
        let pair_count = self.tasks.iter().map(|task| task.pair_count).sum();
        let compared = self.tasks.iter().map(|task| task.compared).sum();
        let times = clock.published();
        Ok(CullReport::new(n, shape, census, pair_count, compared, times).apart_on_axes())
    }

    fn scratch_bytes(&self) -> usize {
        self.columns.allocated_bytes()
            + self.bitmaps.allocated_bytes()
            + self.tasks.iter().map(Task::allocated_bytes).sum::<usize>()
    }

    fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }
}
