//! `cpu-brute`: every box against every box after it, with SIMD. The compare mask *is* the output.
//!
//! The all-pairs test of Avril, Gouranton and Arnaldi 2009 (§3) with rows shared out among threads,
//! each with its own storage, and no shared writes. The stages of a frame:
//!
//! ```text
//! ingest      boxes → keys, one array a coordinate             (engine::ingest)
//! find        every row against the columns after it → words   (search, words)
//! publish     words → a mask, as they are found or at the end  (engine::encode)
//! ```
//!
//! Bytes do not depend on threads or instruction sets: sparse words are the non-zero words of the matrix
//! in its order, and a dense word has one writer. The skip meter counts a pair as left out when its keys
//! were never compared: those of rows without a point.

mod cost;
mod search;
pub(crate) mod split;
mod task;
mod words;

use self::task::Task;
use self::words::WordList;
use crate::engine::encode::{self, DenseRows, DenseWindow};
use crate::engine::gather::Gather;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CpuEngine, CullError, CullInput, CullReport, Engine, EngineDescriptor,
    EngineName, KeyColumns, ReplyBuffer, StageClock,
};
use crate::mask::{Encoding, MaskShape};
use crate::team::{self, Split, for_each_in_parts, in_parts};

/// `cpu-brute` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor::of_cpu(
    "cpu-brute",
    1,
    false,
    CpuEngine { make: |isa| Box::new(BruteForce::on(isa)), terms: cost::TERMS },
);

/// The engine `cpu-brute`. Fastest for tiny scenes, and the reference for the others.
///
/// Its scratch is kept from frame to frame: a steady scene on one thread allocates nothing.
struct BruteForce {
    isa: AvailableIsa,
    columns: KeyColumns,
    tasks: Vec<Task>,
}

impl BruteForce {
    /// The engine with one instruction set that this machine has.
    fn on(isa: AvailableIsa) -> Self {
        Self { isa, columns: KeyColumns::default(), tasks: Vec::new() }
    }

    /// Shares the rows out, one range a task.
    fn assign(&mut self, threads: usize) {
        let ranges = split::ranges(self.columns.len(), threads);
        self.tasks.resize_with(ranges.len(), Task::default);
        for (task, rows) in self.tasks.iter_mut().zip(ranges) {
            task.assign(rows);
        }
    }

    /// After a refusal: the next frame is not expected to have as many.
    fn give_words_back(&mut self) {
        for task in &mut self.tasks {
            task.found = WordList::default();
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
        if encoding == Encoding::Dense {
            let mask = DenseRows::reserve(gather.budget.n(), reply)?;
            let shape = self.run_into(mask, gather, clock);
            gather.budget.check()?;
            return Ok(shape);
        }
        let columns = &self.columns;
        let parts = self.tasks.len();
        for_each_in_parts(&mut self.tasks, parts, |task| task.run(columns, gather));
        clock.executed();
        encode::write(self.tasks.iter().map(|task| &task.found), gather, encoding, false, reply)
    }

    /// Writes the words of each task where they belong, as they are found.
    fn run_into(
        &mut self,
        mut mask: DenseRows<'_>,
        gather: &Gather<'_>,
        clock: &mut StageClock,
    ) -> MaskShape {
        let columns = &self.columns;
        let parts = self.tasks.len();
        let work = InWindow { tasks: &mut self.tasks, window: mask.window() };
        let run = |InWindow { tasks, window }: InWindow<'_>| {
            if let [task] = tasks {
                task.run_into(columns, gather, window);
            }
        };
        in_parts(work, parts, &run, &|(), ()| ());
        clock.executed();
        for task in &self.tasks {
            mask.add_carry(task.rows.end, task.carry);
        }
        mask.shape()
    }
}

/// Tasks, and the part of the reply that holds their rows.
struct InWindow<'a> {
    tasks: &'a mut [Task],
    window: DenseWindow<'a>,
}

impl Split for InWindow<'_> {
    fn len(&self) -> usize {
        self.tasks.len()
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let (tasks, rest) = self.tasks.split_at_mut(at);
        let (window, rest_window) = self.window.split_at_row(rest[0].rows.start);
        (Self { tasks, window }, Self { tasks: rest, window: rest_window })
    }
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
        if input.rules.pass_all() {
            let looked = budget.look_at(|index| boxes.get(index).copied(), None);
            looked.inspect_err(|_| self.give_words_back())?;
        }
        let gather = &Gather { budget, rules: input.rules, order: &[], isa: self.isa, keeps: true };
        let threads = split::threads_for(boxes.len(), input.threads);
        let _team = team::enter(threads);
        let mut clock = StageClock::start();
        let census = self.columns.ingest(boxes, self.isa, budget.cancel())?;
        self.assign(threads);
        input.rules.prepare(boxes.len(), &[], input.threads);
        clock.ingested();
        let published = self.publish(gather, input.encoding, &mut clock, reply);
        let shape = published.inspect_err(|_| self.give_words_back())?;
        let pair_count = self.tasks.iter().map(|task| task.pair_count).sum();
        let compared = self.tasks.iter().map(|task| task.compared).sum();
        let times = clock.published();
        Ok(CullReport::new(n, shape, census, pair_count, compared, times).apart_on_axes())
    }

    fn scratch_bytes(&self) -> usize {
        self.columns.allocated_bytes()
            + self.tasks.iter().map(|task| task.found.allocated_bytes()).sum::<usize>()
    }

    fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }
}
