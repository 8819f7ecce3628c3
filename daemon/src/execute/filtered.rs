//! Frames with rules, and frames of two sets, on the engines of the CPU.

use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::Instant;

use pairmask_core::dispatch::{CullAnswer, CullOptions, FilteredAnswer, nanoseconds_since};
use pairmask_core::engine::{CullError, EngineChoice, ReplyBuffer, ReserveError};
use pairmask_core::precision::BoxSlice;
use pairmask_core::scene;
use pairmask_core::units::BoxCount;
use pairmask_wire::{Page, Reject, RulesPlace, SentRules, WORLD_RANGE_WORDS};

use super::{CpuSide, Executor};

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
}

impl CpuSide {
    /// As [`pairmask_core::dispatch::CpuEngines::cull_filtered`], of boxes in any form.
    fn cull_filtered(
        &mut self,
        boxes: BoxSlice<'_>,
        rules: &SentRules,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<FilteredAnswer<'_>, CullError> {
        let start = Instant::now();
        self.note_expanded(boxes);
        let boxes = boxes.expand(&mut self.expanded, options.threads != Some(1));
        let expand_ns = nanoseconds_since(start);
        // These engines see the rules of one reader alone, or of one frame.
        let known = NonZeroU64::new(rules.number());
        let rules = rules.rules();
        let mut done = self.engines.cull_filtered_known(boxes, rules, known, options, reply)?;
        done.answer.times.ingest_ns += expand_ns;
        done.answer.times.total_ns += expand_ns;
        Ok(done)
    }

    /// As [`scene::cull_between`].
    fn cull_between(
        &mut self,
        boxes: BoxSlice<'_>,
        first: BoxCount,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        self.note_expanded(boxes);
        let boxes = boxes.expand(&mut self.expanded, options.threads != Some(1));
        let expand_ns = nanoseconds_since(start);
        let mut done = scene::cull_between(&mut self.engines, boxes, first, options, reply)?;
        done.times.ingest_ns += expand_ns;
        done.times.total_ns += expand_ns;
        Ok(done)
    }
}

impl Executor {
    /// The rules of a frame of `n` boxes, from its payload, to be kept under the client's number.
    ///
    /// # Errors
    /// [`Reject`].
    pub fn read_rules(
        &mut self,
        place: &RulesPlace,
        number: u64,
        n: BoxCount,
        pages: &[Page],
    ) -> Result<Arc<SentRules>, Reject> {
        self.rules.read_named(place, number, n, pages).map(Arc::clone)
    }

    /// The rules that are kept under the client's number.
    ///
    /// # Errors
    /// [`Reject::UnknownRules`].
    pub fn kept_rules(&self, number: u64, n: BoxCount) -> Result<Arc<SentRules>, Reject> {
        self.rules.named(number, n).map(Arc::clone)
    }

    /// Whether frames with such rules may go to a GPU that culls without them: the rules are then laid
    /// over its mask. Frames of several worlds take a core less time, world by world, than a GPU with all
    /// of their pairs.
    pub fn may_use_gpu(&self, rules: &SentRules, options: &CullOptions) -> bool {
        match options.engine {
            EngineChoice::Only(engine) => engine.is_gpu(),
            EngineChoice::Auto => !self.gpus.is_empty() && rules.most_worlds() == 0,
        }
    }

    /// Finds the pairs of a box of the first `first` and one of the others, with the engines of the CPU.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn cull_between(
        &mut self,
        boxes: BoxSlice<'_>,
        first: BoxCount,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.last_frame = Some(Instant::now());
        self.cpu.cull_between(boxes, first, options, reply)
    }

    /// Finds the pairs that rules let meet, with the engines of the CPU. Where the list is ordered by
    /// world, the reply has room for the ranges behind it.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn cull_filtered(
        &mut self,
        boxes: BoxSlice<'_>,
        rules: &SentRules,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<FilteredAnswer<'_>, CullError> {
        self.last_frame = Some(Instant::now());
        let behind = WORLD_RANGE_WORDS as u64 * rules.most_worlds();
        self.cpu.cull_filtered(boxes, rules, options, &mut RoomBehind { reply, words: behind })
    }
}
