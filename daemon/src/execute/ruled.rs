//! Frames with rules on a GPU: its grid takes worlds and kinds of boxes into account.

use std::cell::OnceCell;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::Instant;

use pairmask_core::cancel::Wanted;
use pairmask_core::dispatch::{
    CullAnswer, CullOptions, FilteredAnswer, Marks, WorldRange, nanoseconds_since,
};
use pairmask_core::engine::{CullError, ReplyBuffer, ReserveError};
use pairmask_core::plan::{Plan, SceneStats};
use pairmask_core::precision::BoxSlice;
use pairmask_core::{BoxCount, Encoding, EncodingChoice, EngineChoice, EngineName, scene};
use pairmask_wire::{RulesReader, SentRules, WORLD_RANGE_WORDS};

use super::frame_memory::{FrameMemory, boxes_of};
use super::gpu::takes_worlds;
use super::{Executor, GpuService, Owner, Planned, offering_reply};

#[derive(Default)]
pub(super) struct CachedMarks {
    /// The number of the rules; 0 before the first.
    of: u64,
    /// Not made where the rules came for the first time; `None` where a GPU cannot take them.
    marks: OnceCell<Option<Arc<Marks>>>,
    ranges: Vec<WorldRange>,
}

impl CachedMarks {
    /// The marks of rules, if a GPU can take them. Rules that come for the first time have none unless
    /// `at_once`: to make marks of a million boxes takes longer than to filter a frame without.
    fn of(
        &mut self,
        rules: &SentRules,
        n: BoxCount,
        threads: usize,
        at_once: bool,
    ) -> Option<Arc<Marks>> {
        // A session's rules of another number, or of more boxes, are others.
        if self.of != rules.number() {
            self.of = rules.number();
            self.marks = OnceCell::new();
            if !at_once {
                return None;
            }
        }
        let make = || {
            let made = Marks::of(rules.rules(), n.len(), threads);
            made.filter(|marks| takes_worlds(marks, n.len())).map(Arc::new)
        };
        self.marks.get_or_init(make).clone()
    }
}

/// A frame with rules whose plan is the grid of a GPU.
pub struct RuledFrame {
    marks: Arc<Marks>,
    pub rules: Arc<SentRules>,
    plan: Plan,
    start: Instant,
}

impl RuledFrame {
    /// Whether the rules have to be laid over the mask all the same: lists name pairs.
    pub fn has_lists(&self) -> bool {
        self.marks.has_lists()
    }
}

impl Executor {
    /// Plans a frame of boxes of several worlds for a GPU; `None` for one that a GPU does not take, or not
    /// sooner than cores.
    pub fn plan_worlds(
        &mut self,
        rules: &Arc<SentRules>,
        n: BoxCount,
        options: &CullOptions,
    ) -> Option<RuledFrame> {
        let start = Instant::now();
        let gpu = self.gpus.for_frame(self.home).and_then(|gpu| gpu.cost())?;
        if matches!(options.engine, EngineChoice::Only(engine) if engine != EngineName::GpuGrid) {
            return None;
        }
        // A list is ordered by world.
        let options = match options.encoding {
            EncodingChoice::Auto => {
                &CullOptions { encoding: EncodingChoice::Only(Encoding::List), ..*options }
            }
            EncodingChoice::Only(_) => options,
        };
        // As one world with as many boxes, which are not looked at: those of all worlds may share a place.
        let stats = SceneStats::unseen(n, options.last_pairs);
        let plan = self.plan_unseen(&stats, Some(gpu), options);
        let (plan_ns, one_core_ns, gpu) = (0, None, None);
        let planned = Planned { plan, options: *options, start, plan_ns, one_core_ns, gpu };
        self.plan_ruled(rules, &planned, options)
    }

    /// The same for a frame whose boxes are of one world, by its plan without rules.
    pub fn plan_ruled(
        &mut self,
        rules: &Arc<SentRules>,
        planned: &Planned,
        options: &CullOptions,
    ) -> Option<RuledFrame> {
        let Planned { plan, start, .. } = planned;
        let n = plan.stats.n;
        let is_grid = plan.engine == EngineName::GpuGrid && plan.encoding != Encoding::Dense;
        if !is_grid || n.get() < 2 {
            return None;
        }
        let is_asked = options.engine != EngineChoice::Auto;
        let marks = self.marks.of(rules, n, options.threads.unwrap_or(1), is_asked)?;
        Some(RuledFrame { marks, rules: Arc::clone(rules), plan: *plan, start: *start })
    }

    /// Finds the pairs of this memory's boxes, which belong to `owner`, and where those of each world
    /// stand, on a GPU. An error leaves the frame to cores.
    pub fn run_ruled<M: FrameMemory>(
        &mut self,
        frame: &RuledFrame,
        owner: Owner,
        memory: &mut M,
    ) -> Result<(CullAnswer, &[WorldRange]), CullError> {
        self.last_frame = Some(Instant::now());
        let RuledFrame { marks, rules, plan, start } = frame;
        let gpu = self.gpus.for_frame(self.home).ok_or(super::no_gpu(plan.engine))?;
        gpu.check_opened(plan.engine)?;
        log::debug!("{}", plan.explain());
        let _queued = gpu.queue(plan, 1);
        let plan_ns = nanoseconds_since(*start);
        let words = WORLD_RANGE_WORDS as u64 * rules.most_worlds();
        let ranges = &mut self.marks.ranges;
        let answer = offering_reply(Some(gpu), memory, |objects, reply| {
            let reply = &mut RoomBehind { reply, words };
            let boxes = boxes_of(objects);
            let cull = |gpu: &mut GpuService| {
                gpu.cull_ruled(boxes, owner, marks, plan.encoding, reply, ranges)
            };
            Ok(CullAnswer::new(plan, gpu.with(cull)?, *start, plan_ns))
        })?;
        Ok((answer, ranges))
    }

    pub const fn rules(&mut self) -> &mut RulesReader {
        &mut self.rules
    }

    /// Whether frames with such rules may go to a GPU that culls without them: the rules are then laid
    /// over its mask. Frames of several worlds take a core less time, world by world, than a GPU with all
    /// of their pairs.
    pub fn may_use_gpu(&self, rules: &SentRules, options: &CullOptions) -> bool {
        match options.engine {
            EngineChoice::Only(engine) => engine.is_gpu(),
            EngineChoice::Auto => self.gpus.iter().next().is_some() && rules.most_worlds() == 0,
        }
    }

    /// Finds the pairs of a box of the first `first` and one of the others, with the engines of the CPU.
    pub fn cull_between(
        &mut self,
        boxes: BoxSlice<'_>,
        first: BoxCount,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.last_frame = Some(Instant::now());
        let (engines, boxes, expand_ns) = self.cpu.expand(boxes, options);
        let mut done = scene::cull_between(engines, boxes, first, options, reply)?;
        done.times.ingest_ns += expand_ns;
        done.times.total_ns += expand_ns;
        Ok(done)
    }

    /// Finds the pairs that rules let meet, with the engines of the CPU. Where the list is ordered by
    /// world, the reply has room for the ranges behind it.
    pub fn cull_filtered(
        &mut self,
        boxes: BoxSlice<'_>,
        rules: &SentRules,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<FilteredAnswer<'_>, CullError> {
        self.last_frame = Some(Instant::now());
        let words = WORLD_RANGE_WORDS as u64 * rules.most_worlds();
        let reply = &mut RoomBehind { reply, words };
        let (engines, boxes, expand_ns) = self.cpu.expand(boxes, options);
        // These engines see the rules of one reader alone, or of one frame.
        let known = NonZeroU64::new(rules.number());
        let mut done = engines.cull_filtered_known(boxes, rules.rules(), known, options, reply)?;
        done.answer.times.ingest_ns += expand_ns;
        done.answer.times.total_ns += expand_ns;
        Ok(done)
    }
}

/// A reply that has room for some words more than an engine asks for.
pub(super) struct RoomBehind<'a> {
    pub(super) reply: &'a mut dyn ReplyBuffer,
    pub(super) words: u64,
}

impl ReplyBuffer for RoomBehind<'_> {
    fn limit_words(&self) -> u64 {
        self.reply.limit_words().saturating_sub(self.words)
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        self.reply.reserve(words.saturating_add(self.words))
    }

    fn asker(&self) -> Option<Arc<dyn Wanted>> {
        self.reply.asker()
    }
}
