//! Frames with rules: culled with them by cores, or by a GPU that takes them into account, or by one that does
//! not, whose mask is filtered when it has ended.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullAnswer, CullOptions, MaskFilter, nanoseconds_since};
use pairmask_core::engine::{CullError, EngineChoice, ReserveError};
use pairmask_wire::SentRules;

use super::between::Sets;
use crate::execute::{Executor, Owner, RuledFrame, boxes_of};
use crate::publish::OpenRequest;

/// Words of a mask from which several threads filter it: a thread takes some 0.1 ms for them.
const SHARED_WORDS: u64 = 1 << 15;
/// Bytes of a pair in a list.
const PAIR_BYTES: u64 = 8;
/// Memory of a filter that no frame needed for so long is given back.
const IDLE: Duration = Duration::from_secs(10);

/// Filters masks that engines without rules have written, with memory that is kept between frames.
#[derive(Default)]
pub(super) struct MaskFilters(Mutex<Kept>);

#[derive(Default)]
struct Kept {
    filter: MaskFilter,
    last_frame: Option<Instant>,
}

/// What is to be done with the answer to a frame.
pub(super) enum Filtered {
    /// It is the answer to the client.
    Done(Result<CullAnswer, CullError>),
    /// The frame is to be culled by a core: its mask without rules had no room, or was malformed.
    CullHere(Arc<SentRules>, CullOptions),
}

impl MaskFilters {
    /// Takes pairs out of the answer to a frame that was culled without its rules. `in_pool` does what has
    /// so many threads.
    pub(super) fn finish(
        &self,
        open: &mut OpenRequest,
        answer: Result<CullAnswer, CullError>,
        in_pool: impl FnOnce(&mut (dyn FnMut(usize) + Send)),
    ) -> Filtered {
        let (n, Some(rules)) = (open.fields().box_count, open.rules_mut()) else {
            return Filtered::Done(answer);
        };
        if rules.is_done {
            return Filtered::Done(answer);
        }
        let (sent, options) = (Arc::clone(&rules.sent), rules.options);
        let mut answer = match answer {
            Ok(answer) => answer,
            // All pairs have no room, where those that meet may have.
            Err(CullError::Reserve(error)) => {
                if let ReserveError::TooLarge { at_least_bytes, .. } = error {
                    rules.found_pairs = Some(at_least_bytes / PAIR_BYTES);
                }
                return Filtered::CullHere(sent, options);
            }
            Err(error) => return Filtered::Done(Err(error)),
        };
        rules.found_pairs = Some(answer.report.pair_count);
        rules.is_done = true;
        let start = Instant::now();
        let mut filter = std::mem::take(&mut self.kept().filter);
        let report = &mut answer.report;
        let is_shared = options.threads != Some(1) && report.shape.extent_words() >= SHARED_WORDS;
        let mut done = Ok(());
        let words = open.words_mut();
        let mut run = |threads| done = filter.filter(sent.rules(), n, words, report, threads);
        if is_shared {
            in_pool(&mut run);
        } else {
            run(1);
        }
        *self.kept() = Kept { filter, last_frame: Some(start) };
        if done.is_err() {
            return Filtered::CullHere(sent, options);
        }
        note_filter_time(&mut answer, start);
        Filtered::Done(Ok(answer))
    }

    /// Takes the pairs of one set out of the answer to a frame of two, in the pool. `None` where the mask is
    /// malformed.
    pub(super) fn keep_sets(
        &self,
        open: &mut OpenRequest,
        mut answer: CullAnswer,
        sets: &Sets<'_>,
    ) -> Option<CullAnswer> {
        let start = Instant::now();
        let (n, words) = (open.fields().box_count, open.words_mut());
        let threads = sets.options.threads.unwrap_or(1);
        let mut filter = std::mem::take(&mut self.kept().filter);
        let done = filter.filter_sets(sets.first, n, words, &mut answer.report, threads);
        *self.kept() = Kept { filter, last_frame: Some(start) };
        note_filter_time(&mut answer, start);
        done.is_ok().then_some(answer)
    }

    /// Gives memory back that has not been used for long; to be called now and then.
    pub(super) fn tidy(&self) {
        let mut kept = self.kept();
        if kept.last_frame.is_some_and(|last| last.elapsed() >= IDLE) {
            *kept = Kept::default();
        }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn note_filter_time(answer: &mut CullAnswer, start: Instant) {
    let filter_ns = nanoseconds_since(start);
    answer.times.publish_ns += filter_ns;
    answer.times.total_ns += filter_ns;
}

/// The options of a frame that cores cull, though an engine of a GPU may have been asked for.
pub(super) fn without_gpu(options: &CullOptions) -> CullOptions {
    let engine = match options.engine {
        EngineChoice::Only(engine) if engine.is_gpu() => EngineChoice::Auto,
        engine => engine,
    };
    CullOptions { engine, ..*options }
}

/// Culls a frame with rules on the engines of the CPU.
pub(super) fn cull_here(
    open: &mut OpenRequest,
    engines: &mut Executor,
    sent: &SentRules,
    options: &CullOptions,
) -> Result<CullAnswer, CullError> {
    if let Some(rules) = open.rules_mut() {
        rules.is_done = true;
    }
    let (objects, mut reply) = open.parts();
    let options = without_gpu(options);
    let done = engines.cull_filtered(boxes_of(objects), sent, &options, &mut reply)?;
    open.put_world_ranges(&done.answer.report.shape, done.worlds);
    Ok(done.answer)
}

/// Finds the pairs of a frame with rules on a GPU that takes them into account; on the engines of the CPU
/// where the GPU does not serve it. Where lists name pairs, the rules are laid over the mask afterwards.
pub(super) fn cull_there(
    open: &mut OpenRequest,
    engines: &mut Executor,
    frame: &RuledFrame,
    owner: Owner,
    options: &CullOptions,
) -> Result<CullAnswer, CullError> {
    match engines.run_ruled(frame, owner, open) {
        Ok((answer, worlds)) => {
            if let Some(rules) = open.rules_mut() {
                rules.is_done = !frame.has_lists();
            }
            open.put_world_ranges(&answer.report.shape, worlds);
            Ok(answer)
        }
        Err(error) => {
            log::debug!("a frame with rules goes to cores: {error}");
            cull_here(open, engines, frame.rules(), options)
        }
    }
}
