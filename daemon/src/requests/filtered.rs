//! Frames with rules: culled with them by cores, or by a GPU that takes them into account, or by one that does
//! not, whose mask is filtered when it has ended.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullAnswer, CullOptions, MaskFilter, nanoseconds_since};
use pairmask_core::engine::{CullError, CullReport, ReserveError};
use pairmask_core::scene::is_small_set;
use pairmask_core::{BoxCount, EngineChoice};
use pairmask_wire::SentRules;

use super::PAIR_BYTES;
use crate::clients::GpuNeed;
use crate::execute::{Executor, Owner, Planned, RuledFrame, boxes_of};
use crate::locked;
use crate::publish::OpenRequest;

/// Words of a mask from which several threads filter it: a thread takes some 0.1 ms for them.
const SHARED_WORDS: u64 = 1 << 15;
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

pub(super) enum Filtered {
    Done(Result<CullAnswer, CullError>),
    /// The frame is to be culled by a core: its mask without rules had no room, or was malformed.
    CullHere(Arc<SentRules>, CullOptions),
}

impl MaskFilters {
    /// Takes pairs out of an answer without rules; `in_pool` does what has so many threads.
    pub(super) fn finish(
        &self,
        open: &mut OpenRequest,
        answer: Result<CullAnswer, CullError>,
        in_pool: impl FnOnce(&mut (dyn FnMut(usize) + Send)),
    ) -> Filtered {
        let (n, Some(rules)) = (open.fields.box_count, open.rules.as_mut()) else {
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
        let words = answer.report.shape.extent_words();
        let is_shared = options.threads != Some(1) && words >= SHARED_WORDS;
        let is_done = self.filter(open, &mut answer, |filter, words, report| {
            let mut done = Ok(());
            let mut run = |threads| done = filter.filter(sent.rules(), n, words, report, threads);
            if is_shared {
                in_pool(&mut run);
            } else {
                run(1);
            }
            done.is_ok()
        });
        if is_done { Filtered::Done(Ok(answer)) } else { Filtered::CullHere(sent, options) }
    }

    /// Has `work` take pairs out of an answer, whose time counts as that of publishing. Whether it could.
    fn filter(
        &self,
        open: &mut OpenRequest,
        answer: &mut CullAnswer,
        work: impl FnOnce(&mut MaskFilter, &mut [u32], &mut CullReport) -> bool,
    ) -> bool {
        let start = Instant::now();
        let mut filter = std::mem::take(&mut locked(&self.0).filter);
        let is_done = work(&mut filter, open.words_mut(), &mut answer.report);
        *locked(&self.0) = Kept { filter, last_frame: Some(start) };
        let filter_ns = nanoseconds_since(start);
        answer.times.publish_ns += filter_ns;
        answer.times.total_ns += filter_ns;
        is_done
    }

    pub(super) fn tidy(&self) {
        let mut kept = locked(&self.0);
        if kept.last_frame.is_some_and(|last| last.elapsed() >= IDLE) {
            *kept = Kept::default();
        }
    }

    /// The pairs of a box of the first set and one of the second, and whether that needed a GPU: one culls the whole
    /// frame, and the pairs of one set are taken out. Where all pairs have no room, or the mask is malformed, cores find
    /// those of two sets.
    pub(super) fn cull_between(
        &self,
        open: &mut OpenRequest,
        sets: &Sets<'_>,
        engines: &mut Executor,
    ) -> (GpuNeed, Result<CullAnswer, CullError>) {
        let Some(planned) = sets.plan_for_gpu(open, engines) else {
            return (GpuNeed::None, sets.cull_here(open, engines));
        };
        let owner = Owner::Client(open.segment());
        let answer = match engines.run(planned, owner, open) {
            Ok(mut answer) => {
                let (n, threads) = (open.fields.box_count, sets.options.threads.unwrap_or(1));
                let is_done = self.filter(open, &mut answer, |filter, words, report| {
                    filter.filter_sets(sets.first, n, words, report, threads).is_ok()
                });
                is_done.then_some(Ok(answer))
            }
            Err(CullError::Reserve(_)) => None,
            Err(error) => Some(Err(error)),
        };
        (GpuNeed::Alone, answer.unwrap_or_else(|| sets.cull_here(open, engines)))
    }
}

/// The options of a frame that cores cull, though an engine of a GPU may have been asked for.
pub(super) fn without_gpu(options: &CullOptions) -> CullOptions {
    let engine = match options.engine {
        EngineChoice::Only(engine) if engine.is_gpu() => EngineChoice::Auto,
        engine => engine,
    };
    CullOptions { engine, ..*options }
}

pub(super) fn cull_here(
    open: &mut OpenRequest,
    engines: &mut Executor,
    sent: &SentRules,
    options: &CullOptions,
) -> Result<CullAnswer, CullError> {
    if let Some(rules) = open.rules.as_mut() {
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
            if let Some(rules) = open.rules.as_mut() {
                rules.is_done = !frame.has_lists();
            }
            open.put_world_ranges(&answer.report.shape, worlds);
            Ok(answer)
        }
        Err(error) => {
            log::debug!("a frame with rules goes to cores: {error}");
            cull_here(open, engines, &frame.rules, options)
        }
    }
}

pub(super) struct Sets<'a> {
    pub first: BoxCount,
    pub options: &'a CullOptions,
    pub beside_others: bool,
}

impl Sets<'_> {
    /// The plan of the whole frame, if that goes to a GPU: where one is named, or where the sets are as large as
    /// each other and the plan is left open.
    fn plan_for_gpu(&self, open: &OpenRequest, engines: &mut Executor) -> Option<Planned> {
        let Self { first, options, beside_others } = self;
        let boxes = boxes_of(open.objects());
        let threads = options.threads.unwrap_or(1);
        match options.engine {
            EngineChoice::Only(engine) if !engine.is_gpu() => return None,
            EngineChoice::Auto if is_small_set(*first, boxes.len(), threads) => return None,
            _ => {}
        }
        let limit_words = open.limit_words();
        let planned = engines.plan_beside(*beside_others, boxes, options, limit_words);
        Some(planned).filter(Planned::is_gpu)
    }

    fn cull_here(
        &self,
        open: &mut OpenRequest,
        engines: &mut Executor,
    ) -> Result<CullAnswer, CullError> {
        let (objects, mut reply) = open.parts();
        let options = without_gpu(self.options);
        engines.cull_between(boxes_of(objects), self.first, &options, &mut reply)
    }
}
