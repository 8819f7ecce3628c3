//! Requests for the pairs of a scene.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use pairmask_core::BoxCount;
use pairmask_core::dispatch::{CullAnswer, CullOptions};
use pairmask_core::engine::CullError;
use pairmask_core::objects::Objects;
use pairmask_core::repeat::Seen;
use pairmask_wire::{CullRequest, Reject, SentRules};

use super::filtered::{Filtered, MaskFilters, Sets};
use super::gpu_lines::{GpuLine, Submission};
use super::{Served, filtered, threads_of};
use crate::clients::{GpuNeed, SessionEngines};
use crate::execute::{
    BUNDLE_FRAMES, Ended, EnginePool, Executor, Gpus, Joining, Owner, RuledFrame, Unserved,
};
use crate::locked;
use crate::publish::{OpenRequest, Outbox};

pub(crate) struct Culls {
    /// Sessions get engines like these, which no session has.
    model: Mutex<Executor>,
    lines: Vec<GpuLine>,
    filters: MaskFilters,
    pool: Arc<EnginePool>,
    outbox: Arc<Outbox>,
}

impl Culls {
    pub(super) fn new(model: Executor, pool: Arc<EnginePool>, outbox: Arc<Outbox>) -> Self {
        Self {
            lines: model.gpus().iter().cloned().map(GpuLine::new).collect(),
            model: Mutex::new(model),
            filters: MaskFilters::default(),
            pool,
            outbox,
        }
    }

    pub(crate) fn gpus(&self) -> Gpus {
        locked(&self.model).gpus().clone()
    }

    /// Whether a frame is under way: then [`Self::publish_ended`] is to be called soon.
    pub(crate) fn is_busy(&self) -> bool {
        self.lines.iter().any(GpuLine::is_busy)
    }

    pub(crate) fn rest(&self) {
        if let Some(line) = self.lines.iter().find(|line| line.is_busy()) {
            line.gpu.rest();
        }
    }

    /// Segments of clients, by their numbers, are mapped: what is known of others ends.
    pub(super) fn tidy(&self, segments: &[u64]) {
        self.lines.iter().for_each(|line| line.gpu.tidy(segments));
        self.filters.tidy();
    }

    /// Has the GPUs let go of the memory of replies in a range of addresses, none of which is lent. Whether they did.
    pub(super) fn release_reply(&self, range: &Range<usize>) -> bool {
        self.lines.iter().all(|line| line.gpu.release_reply(range))
    }

    pub(super) fn take(&self, open: OpenRequest, request: &CullRequest, threads: usize) -> Served {
        let mut joining = Vec::new();
        // A submission that is under way need not be waited for: this thread can do more meanwhile.
        let joins = self.is_busy().then_some(&mut joining);
        let served = self.take_one(open, request, threads, joins);
        self.begin_bundle(joining);
        served
    }

    /// Answers several requests, or leaves them under way. Small frames for the GPU share a submission.
    /// An error is one that was served already.
    pub(super) fn take_bundle(
        &self,
        requests: impl IntoIterator<Item = Result<(OpenRequest, CullRequest), Served>>,
        threads: usize,
    ) -> Vec<Served> {
        let mut joining = Vec::with_capacity(BUNDLE_FRAMES);
        let mut take = |(open, request): (OpenRequest, CullRequest)| {
            if joining.len() == BUNDLE_FRAMES {
                self.begin_bundle(std::mem::take(&mut joining));
            }
            self.take_one(open, &request, threads, Some(&mut joining))
        };
        let served = requests.into_iter().map(|request| request.map_or_else(|s| s, &mut take));
        let served = served.collect();
        self.begin_bundle(joining);
        served
    }

    /// Answers a request, leaves it under way, or adds its frame to those that are `joining` others.
    fn take_one(
        &self,
        mut open: OpenRequest,
        request: &CullRequest,
        threads: usize,
        joining: Option<&mut Vec<Joining<OpenRequest>>>,
    ) -> Served {
        let session = open.sender.session;
        let kept = self.outbox.clients.of(session, |client| client.engines.take());
        let new = || Box::new(SessionEngines::new(self.new_engines(), open.share()));
        let mut engines = kept.unwrap_or_else(new);
        // A client that is alone may have all of them.
        let beside_others = threads < self.pool.threads();
        let threads = threads_of(request.threads, threads);
        let options = CullOptions {
            engine: request.engine,
            encoding: request.encoding,
            threads: Some(threads),
            iterate_threads: request.iterate_threads,
            last_pairs: self.outbox.clients.last_pairs(session),
            ..CullOptions::default()
        };
        let room = engines.make_room(request.scene.count);
        let used =
            if let Err(over) = room.and_then(|()| open.charge_words(request.scene.count.get())) {
                self.outbox.refuse_and_close(open, over.into())
            } else {
                let (way, executor) = ((beside_others, joining), &mut engines.executor);
                let cull = || self.cull(open, request, &options, way, executor);
                self.work(RunsOn::Worker, options.threads, cull)
            };
        engines.note_room();
        self.outbox.clients.of(session, |client| client.engines = Some(engines));
        used
    }

    fn cull(
        &self,
        mut open: OpenRequest,
        request: &CullRequest,
        options: &CullOptions,
        (beside_others, joining): (bool, Option<&mut Vec<Joining<OpenRequest>>>),
        engines: &mut Executor,
    ) -> Served {
        let placed = open.slot_scene(request.scene);
        let rules = match placed.and_then(|()| read_rules(&open, request, engines)) {
            Ok(rules) => rules,
            Err(reject) => return self.outbox.refuse_and_close(open, reject.into()),
        };
        if let Some(first) = request.first_set {
            let sets = Sets { first, options, beside_others };
            let (gpu, answer) = self.filters.cull_between(&mut open, &sets, engines);
            return Served { gpu, ..self.publish(open, Some(first), answer) };
        }
        let owner = Owner::Client(open.segment());
        let limit_words = open.limit_words();
        let mut seen = Seen::New;
        if request.may_repeat {
            let (objects, mut reply) = open.parts();
            let number = rules.as_ref().map_or(0, |rules| rules.number());
            seen = engines.repeats().look(objects, options, number, &mut reply);
        }
        if let Seen::Answered(answer) = seen {
            open.note_world_ranges(&answer.report.shape, engines.repeats().words_behind());
            if let Some(rules) = rules {
                open.put_rules(rules, *options, true);
            }
            // The next frame is judged by the last one that was culled.
            return Served { is_frame: false, ..self.publish(open, None, Ok(answer)) };
        }
        let is_alike = seen == Seen::Alike;
        if let Some(rules) = &rules {
            open.put_rules(Arc::clone(rules), *options, false);
        }
        if let Some(rules) = rules.as_ref().filter(|rules| rules.most_worlds() > 0)
            && let Some(frame) = engines.plan_worlds(rules, request.scene.count, options)
        {
            let way = (options, is_alike, GpuNeed::Alone);
            return self.run_ruled(open, &frame, way, engines);
        }
        let on_gpu = rules.as_ref().is_none_or(|rules| engines.may_use_gpu(rules, options));
        if let Some(rules) = rules.as_ref().filter(|_| !on_gpu) {
            let answer = filtered::cull_here(&mut open, engines, rules, options);
            open.keep = engines.ticket(is_alike);
            return self.publish(open, None, answer);
        }
        let boxes = match open.parts() {
            (Objects::Boxes(boxes), _) => boxes,
            (Objects::Spheres(_), _) => {
                let answer = engines.run_spheres(owner, options, &mut open);
                open.keep = engines.ticket(is_alike);
                return self.publish(open, None, answer);
            }
        };
        let planned = engines.plan_beside(beside_others, boxes, options, limit_words);
        if let Some(rules) = rules.filter(|_| !planned.is_gpu()) {
            open.keep = engines.ticket(is_alike);
            let on_one_core = planned.on_one_core();
            let answer = filtered::cull_here(&mut open, engines, &rules, options);
            return Served { on_one_core, ..self.publish(open, None, answer) };
        }
        if let Some(rules) = open.rules.as_ref().map(|rules| Arc::clone(&rules.sent))
            && let Some(frame) = engines.plan_ruled(&rules, &planned, options)
        {
            let gpu = if planned.needs_gpu() { GpuNeed::Alone } else { GpuNeed::None };
            return self.run_ruled(open, &frame, (options, is_alike, gpu), engines);
        }
        let keeps = is_alike && planned.is_sooner_compared(open.objects());
        open.keep = engines.ticket(keeps);
        let can_join = engines.can_join(&planned);
        let gpu = match planned.needs_gpu() {
            false => GpuNeed::None,
            true if can_join => GpuNeed::Shared,
            true => GpuNeed::Alone,
        };
        if let Some(joining) = joining.filter(|_| can_join) {
            joining.push(Executor::join(planned, owner, open));
            return Served { gpu, ..Served::BEGUN };
        }
        let line = self.lines.get(planned.gpu_index());
        if let Some(line) = line.filter(|_| engines.can_begin(&planned)) {
            self.claim_slot(line, RunsOn::of(options));
            match engines.begin(planned, owner, open) {
                Ok(first) => {
                    line.put(Submission { first, others: Vec::new() });
                    Served { gpu, ..Served::BEGUN }
                }
                Err(ended) => {
                    line.give_slot_back();
                    self.publish_all(ended, RunsOn::of(options))
                }
            }
        } else {
            let on_one_core = planned.on_one_core();
            let answer = engines.run(planned, owner, &mut open);
            if let Ok(answer) = &answer {
                engines.note_gpu(request.scene.count, answer);
            }
            Served { on_one_core, gpu, ..self.finish(open, answer, RunsOn::of(options)) }
        }
    }

    /// Answers a frame with rules by a GPU that takes them into account, or by cores where it fails.
    fn run_ruled(
        &self,
        mut open: OpenRequest,
        frame: &RuledFrame,
        (options, is_alike, gpu): (&CullOptions, bool, GpuNeed),
        engines: &mut Executor,
    ) -> Served {
        let owner = Owner::Client(open.segment());
        open.keep = engines.ticket(is_alike);
        let answer = filtered::cull_there(&mut open, engines, frame, owner, options);
        Served { gpu, ..self.finish(open, answer, RunsOn::of(options)) }
    }

    /// Leaves frames to the GPU of the first of them, in one submission, if there are any.
    fn begin_bundle(&self, joining: Vec<Joining<OpenRequest>>) {
        let first = joining.first();
        let Some(line) = first.and_then(|frame| self.lines.get(frame.gpu_index())) else { return };
        self.claim_slot(line, RunsOn::Worker);
        let (mut begun, mut unserved) = (Vec::with_capacity(joining.len()), Vec::new());
        for frame in line.gpu.begin_bundle(joining) {
            match frame {
                Ok(frame) => begun.push(frame),
                Err(frame) => unserved.push(frame),
            }
        }
        if begun.is_empty() {
            line.give_slot_back();
        } else {
            let first = begun.remove(0);
            line.put(Submission { first, others: begun });
        }
        for frame in unserved {
            self.publish_all(self.answer(frame, RunsOn::Worker), RunsOn::Worker);
        }
    }

    /// Publishes the oldest frame on each GPU if it has ended and is no other thread's. Whether any.
    pub(crate) fn publish_ended(&self) -> bool {
        let mut any = false;
        for line in &self.lines {
            if let Some(submission) = line.take_ended() {
                self.end(line, submission, RunsOn::Worker);
                any = true;
            }
        }
        any
    }

    /// Claims one of the slots for frames under way. Ends frames until one is free.
    fn claim_slot(&self, line: &GpuLine, runs_on: RunsOn) {
        while !line.claim_slot() {
            match line.take_oldest() {
                Some(submission) => self.end(line, submission, runs_on),
                // Other threads end them, or are about to begin theirs.
                None => std::thread::yield_now(),
            }
        }
    }

    fn end(&self, line: &GpuLine, submission: Submission, runs_on: RunsOn) {
        let Submission { first, others } = submission;
        // Its workspaces are free when the last frame has ended.
        let frames = others.len() + 1;
        for (frame, number) in std::iter::once(first).chain(others).zip(1..) {
            let ended = frame.end();
            if number == frames {
                line.give_slot_back();
            }
            let ended = ended.unwrap_or_else(|unserved| self.answer(unserved, runs_on));
            self.publish_all(ended, runs_on);
        }
    }

    /// Publishes what became of a frame. A device that hangs may keep the request: then its client's
    /// deadline ends its wait.
    fn publish_all(&self, (answer, open): Ended<OpenRequest>, runs_on: RunsOn) -> Served {
        open.map_or(Served::BEGUN, |open| self.finish(open, answer, runs_on))
    }

    /// Publishes an answer that was found without the frame's rules, if it has any.
    fn finish(
        &self,
        mut open: OpenRequest,
        answer: Result<CullAnswer, CullError>,
        runs_on: RunsOn,
    ) -> Served {
        let finished = self.filters.finish(&mut open, answer, |work| {
            self.work(runs_on, None, || work(self.pool.threads()));
        });
        let answer = match finished {
            Filtered::Done(answer) => answer,
            Filtered::CullHere(rules, options) => {
                let mut engines = self.new_engines();
                let cull = || filtered::cull_here(&mut open, &mut engines, &rules, &options);
                self.work(runs_on, options.threads, cull)
            }
        };
        self.publish(open, None, answer)
    }

    fn publish(
        &self,
        mut open: OpenRequest,
        first_set: Option<BoxCount>,
        answer: Result<CullAnswer, CullError>,
    ) -> Served {
        let threads = answer.as_ref().map_or(1, |answer| answer.threads);
        let on_gpu = answer.as_ref().is_ok_and(|answer| answer.engine.is_gpu());
        match answer {
            Ok(answer) => {
                open.keep(&answer);
                self.outbox.answer(&mut open, first_set, answer);
            }
            Err(error) => self.outbox.refuse(&mut open, &error.into()),
        }
        drop(open);
        Served { threads, on_gpu, ..Served::BEGUN }
    }

    fn answer(&self, unserved: Unserved<OpenRequest>, runs_on: RunsOn) -> Ended<OpenRequest> {
        let mut engines = self.new_engines();
        self.work(runs_on, unserved.threads(), move || engines.answer(unserved))
    }

    /// Does work that may use so many threads: more than one are the pool's.
    fn work<R: Send>(
        &self,
        runs_on: RunsOn,
        threads: Option<usize>,
        work: impl FnOnce() -> R + Send,
    ) -> R {
        if runs_on == RunsOn::Worker && threads != Some(1) { self.pool.work(work) } else { work() }
    }

    fn new_engines(&self) -> Executor {
        locked(&self.model).beside()
    }
}

/// Where a thread is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RunsOn {
    /// Outside of the pool's work: parallel engines have to be given to it.
    Worker,
    /// In the pool's work, which is not begun a second time from within.
    Pool,
}

impl RunsOn {
    fn of(options: &CullOptions) -> Self {
        if options.threads == Some(1) { Self::Worker } else { Self::Pool }
    }
}

/// The rules of a request; `None` where it has none, or those let all boxes meet.
fn read_rules(
    open: &OpenRequest,
    request: &CullRequest,
    engines: &mut Executor,
) -> Result<Option<Arc<SentRules>>, Reject> {
    let (n, number) = (request.scene.count, request.rules_number);
    let rules = match &request.rules {
        Some(runs_on) => engines.rules().read_named(runs_on, number, n, open.pages())?,
        None if number == 0 => return Ok(None),
        None => engines.rules().named(number, n)?,
    };
    Ok((!rules.let_all_meet()).then(|| Arc::clone(rules)))
}
