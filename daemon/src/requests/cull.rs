//! Requests for the pairs of a scene.

use std::collections::VecDeque;

use pairmask_core::dispatch::{CullAnswer, CullOptions};
use pairmask_core::engine::CullError;
use pairmask_core::mask::ReadableEncodings;
use pairmask_core::objects::Objects;
use pairmask_wire::CullRequest;

use crate::execute::{CullUnderWay, Ended, Executor, FRAMES_UNDER_WAY, Owner};
use crate::publish::{OpenRequest, Outbox};

/// The engines, and the frames that they have not ended yet.
pub(super) struct Culls {
    executor: Executor,
    /// Oldest first.
    under_way: VecDeque<CullUnderWay<OpenRequest>>,
}

impl Culls {
    /// No frame yet.
    pub(super) fn new(executor: Executor) -> Self {
        Self { executor, under_way: VecDeque::with_capacity(FRAMES_UNDER_WAY) }
    }

    /// Whether another frame can be taken in.
    pub(super) fn has_room(&self) -> bool {
        self.under_way.len() < FRAMES_UNDER_WAY
    }

    /// Whether a frame is under way.
    pub(super) fn is_busy(&self) -> bool {
        !self.under_way.is_empty()
    }

    /// Lets the engines work for a moment.
    pub(super) fn rest(&mut self) {
        self.executor.rest();
    }

    /// Gives up what belonged to clients that are gone.
    pub(super) fn tidy(&mut self) {
        self.executor.tidy();
    }

    /// Answers a request, or leaves it under way.
    pub(super) fn take(
        &mut self,
        mut open: OpenRequest,
        request: &CullRequest,
        outbox: &mut Outbox,
    ) {
        if let Err(reject) = open.place_scene(request.scene) {
            return outbox.refuse(&mut open, &reject.into());
        }
        let sender = open.sender();
        let options = CullOptions {
            engine: request.engine,
            encoding: request.encoding,
            threads: request.threads,
            visit_threads: request.visit_threads,
            last_pairs: outbox.clients().last_pairs(sender.session),
            readable: ReadableEncodings::at_minor(request.client_minor),
        };
        let limit_words = open.limit_words();
        let boxes = match open.parts() {
            (Objects::Boxes(boxes), _) => boxes,
            (Objects::Spheres(spheres), mut reply) => {
                let answer = self.executor.cull_spheres(spheres, &options, &mut reply);
                return publish(&mut open, answer, outbox);
            }
        };
        let owner = Owner::Client(sender.port);
        let planned = self.executor.plan(boxes, &options, limit_words);
        if self.executor.can_begin(&planned) {
            match self.executor.begin(planned, owner, open) {
                Ok(cull) => self.under_way.push_back(cull),
                Err(ended) => publish_all(ended, outbox),
            }
        } else {
            let answer = self.executor.run(planned, owner, &mut open);
            publish(&mut open, answer, outbox);
        }
    }

    /// Publishes the oldest frame under way if it has ended. Whether it had.
    pub(super) fn publish_ended(&mut self, outbox: &mut Outbox) -> bool {
        if !self.under_way.front().is_some_and(CullUnderWay::has_ended) {
            return false;
        }
        let Some(cull) = self.under_way.pop_front() else { return false };
        publish_all(self.executor.end(cull), outbox);
        true
    }
}

/// Publishes what became of a frame. A device that hangs may keep the request: then its client's
/// deadline ends its wait.
fn publish_all((answer, open): Ended<OpenRequest>, outbox: &mut Outbox) {
    if let Some(mut open) = open {
        publish(&mut open, answer, outbox);
    }
}

fn publish(open: &mut OpenRequest, answer: Result<CullAnswer, CullError>, outbox: &mut Outbox) {
    match answer {
        Ok(answer) => outbox.answer(open, answer),
        Err(error) => outbox.refuse(open, &error.into()),
    }
}
