//! The frame of an engine that brings boxes into an order of its own: what `cpu-sap`, `cpu-grid` and `cpu-tree`
//! share.

use super::encode;
use super::gather::Gather;
use super::strips::{OrderedBoxes, STRIP_COLUMNS, StripTask};
use super::word_budget::WordBudget;
use super::{
    AvailableIsa, Census, CullError, CullInput, CullReport, Engine, EngineName, ReplyBuffer,
    StageClock,
};
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::mask::{Encoding, MaskShape};
use crate::team::{self, for_each_in_parts, part_count};

/// How an engine orders boxes, and searches among them. Memory is kept from frame to frame.
pub(super) trait Arrangement: Default + Send + Sync {
    /// Which engine it is.
    const NAME: EngineName;
    /// Fewest boxes that are worth a second thread.
    const PARALLEL_BOXES: usize;
    /// Fewest rows of a task: below, handing it to another thread costs more than it saves.
    const TASK_ROWS: usize;
    /// Whether another engine takes over where there are more tests than that one takes time.
    const HANDS_OVER: bool;
    /// Whether pairs are left out by cells, and not by axes.
    const HAS_CELLS: bool;

    /// What a task needs to search.
    type Own: Default + Send + Sync;

    /// Reads the boxes, each once but for a sample that only advises, and brings them into order, unless cancelled. What
    /// overlaps nothing stands last.
    fn arrange(
        &mut self,
        boxes: &[Aabb],
        threads: usize,
        may_hand_over: bool,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Result<Census, CullError>;

    /// The boxes in order.
    fn boxes(&self) -> &OrderedBoxes;

    /// Finds the words of a task's rows, until the budget is spent. Boxes from position `valid` on overlap
    /// nothing.
    fn search(&self, task: &mut StripTask<Self::Own>, valid: u32, gather: &Gather<'_>);

    /// Bytes of a task's own memory.
    fn own_bytes(_own: &Self::Own) -> usize {
        0
    }

    /// Bytes that are allocated.
    fn allocated_bytes(&self) -> usize;
}

/// An engine with an order of its own.
///
/// Its scratch is kept from frame to frame: a steady scene allocates nothing, but for a little where a tree is cut, or a
/// table of cells is folded.
pub(super) struct Ordered<A: Arrangement> {
    isa: AvailableIsa,
    arrangement: A,
    tasks: Vec<StripTask<A::Own>>,
}

impl<A: Arrangement> Ordered<A> {
    /// The engine with one instruction set that this machine has.
    pub fn on(isa: AvailableIsa) -> Self {
        Self { isa, arrangement: A::default(), tasks: Vec::new() }
    }

    /// Shares the rows out, in whole blocks, so that no block depends on how many threads there are.
    fn assign(&mut self, rows: usize, threads: usize) {
        let parts = part_count(rows, A::TASK_ROWS, threads);
        self.tasks.resize_with(parts, StripTask::default);
        let border = |part: usize| match part {
            last if last == parts => rows as u32,
            _ => (rows * part / parts / STRIP_COLUMNS * STRIP_COLUMNS) as u32,
        };
        for (part, task) in self.tasks.iter_mut().enumerate() {
            task.rows = border(part)..border(part + 1);
        }
    }
}

impl<A: Arrangement> Engine for Ordered<A> {
    fn name(&self) -> EngineName {
        A::NAME
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, n) = input.f32_boxes(A::NAME)?;
        let new_budget = |reply: &dyn ReplyBuffer| -> Result<WordBudget, CullError> {
            let budget = WordBudget::new(n, input.encoding, true, reply)?;
            Ok(budget.handing_over(A::NAME, A::HANDS_OVER && input.may_hand_over))
        };
        let mut budget = new_budget(reply)?;
        let get = |index: usize| boxes.get(index).copied();
        let is_counted_first = input.rules.pass_all()
            && budget.look_at(get, None).inspect_err(|_| give_words_back(&mut self.tasks))?;
        let threads = if boxes.len() < A::PARALLEL_BOXES { 1 } else { input.threads.max(1) };
        let _team = team::enter(threads);
        let mut clock = StageClock::start();
        let (may, isa) = (input.may_hand_over, self.isa);
        let census = self.arrangement.arrange(boxes, threads, may, isa, budget.cancel())?;
        let valid = census.valid_of(boxes.len());
        clock.ingested();

        self.assign(valid, threads);
        let (arrangement, parts) = (&self.arrangement, self.tasks.len());
        let order = arrangement.boxes().order();
        input.rules.prepare(boxes.len(), order, threads);
        let tasks = &mut self.tasks;
        let mut search = |budget: &WordBudget, keeps: bool| {
            let gather = &Gather { budget, rules: input.rules, order, isa: self.isa, keeps };
            let search =
                |task: &mut StripTask<A::Own>| arrangement.search(task, valid as u32, gather);
            for_each_in_parts(tasks, parts, search);
        };
        if is_counted_first {
            search(&budget, false);
            budget.check()?;
            budget = new_budget(reply)?;
        }
        search(&budget, true);
        clock.executed();

        let is_shared = threads > 1;
        let gather =
            &Gather { budget: &budget, rules: input.rules, order, isa: self.isa, keeps: true };
        let (shape, pairs) = publish(&mut self.tasks, gather, input.encoding, is_shared, reply)?;
        let compared = self.tasks.iter().map(|task| task.compared).sum();
        let report = CullReport::new(n, shape, census, pairs, compared, clock.published());
        Ok(if A::HAS_CELLS { report } else { report.apart_on_axes() })
    }

    fn scratch_bytes(&self) -> usize {
        let of_task = |task: &StripTask<A::Own>| task.allocated_bytes() + A::own_bytes(&task.own);
        self.arrangement.allocated_bytes() + self.tasks.iter().map(of_task).sum::<usize>()
    }

    fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }
}

/// After a refusal: the next frame is not expected to have as many.
fn give_words_back<Own>(tasks: &mut [StripTask<Own>]) {
    for task in tasks {
        task.found.give_back();
    }
}

/// Writes the mask of what tasks have found; returns where it lies, and its pairs. After a refusal the words'
/// memory is given back; not where nobody waits any more, since that takes as long as some of the work.
pub(crate) fn publish<Own: Sync>(
    tasks: &mut [StripTask<Own>],
    gather: &Gather<'_>,
    encoding: Encoding,
    is_shared: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<(MaskShape, u64), CullError> {
    let sinks = tasks.iter().map(|task| &task.found);
    match encode::write(sinks, gather, encoding, is_shared, reply) {
        Ok(shape) => Ok((shape, tasks.iter().map(|task| task.found.pair_count()).sum())),
        Err(error) => {
            if error != CullError::Cancelled {
                give_words_back(tasks);
            }
            Err(error)
        }
    }
}
