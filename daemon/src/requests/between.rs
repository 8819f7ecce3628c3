//! Frames of two sets: by cores, or by a GPU as one frame, out of whose mask the pairs of one set are taken.

use pairmask_core::dispatch::{CullAnswer, CullOptions};
use pairmask_core::engine::{CullError, EngineChoice};
use pairmask_core::scene::is_small_set;
use pairmask_core::units::BoxCount;

use super::Served;
use super::filtered::{MaskFilters, without_gpu};
use crate::clients::GpuNeed;
use crate::execute::{Executor, Owner, Planned, boxes_of};
use crate::publish::{OpenRequest, Outbox};

/// A frame of two sets.
pub(super) struct Sets<'a> {
    /// Boxes of the first.
    pub first: BoxCount,
    pub options: &'a CullOptions,
    /// Whether other clients are busy.
    pub beside_others: bool,
}

impl MaskFilters {
    /// Answers a frame of two sets.
    pub(super) fn cull_between(
        &self,
        mut open: OpenRequest,
        sets: &Sets<'_>,
        engines: &mut Executor,
        outbox: &Outbox,
    ) -> Served {
        let planned = sets.plan_for_gpu(&open, engines);
        let gpu = if planned.is_some() { GpuNeed::Alone } else { GpuNeed::None };
        let answered = match planned {
            Some(planned) => self.cull_on_gpu(&mut open, planned, sets, engines),
            None => sets.cull_here(&mut open, engines),
        };
        let threads = answered.as_ref().map_or(1, |answer| answer.threads);
        match answered {
            Ok(answer) => outbox.answer_between(&mut open, sets.first, answer),
            Err(error) => outbox.refuse(&mut open, &error.into()),
        }
        open.close();
        Served { threads, on_gpu: gpu != GpuNeed::None, gpu, ..Served::BEGUN }
    }

    /// Has a GPU cull the whole frame, and takes the pairs of one set out. Where all pairs have no room, cores
    /// find those of two sets.
    fn cull_on_gpu(
        &self,
        open: &mut OpenRequest,
        planned: Planned,
        sets: &Sets<'_>,
        engines: &mut Executor,
    ) -> Result<CullAnswer, CullError> {
        let owner = Owner::Client(open.sender().port);
        let answer = match engines.run(planned, owner, open) {
            Ok(answer) => answer,
            Err(CullError::Reserve(_)) => return sets.cull_here(open, engines),
            Err(error) => return Err(error),
        };
        match self.keep_sets(open, answer, sets) {
            Some(answer) => Ok(answer),
            None => sets.cull_here(open, engines),
        }
    }
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
        let planned = if *beside_others {
            engines.plan_beside_others(boxes, options, limit_words)
        } else {
            engines.plan(boxes, options, limit_words)
        };
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
