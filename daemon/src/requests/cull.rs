//! Requests for the pairs of a scene.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pairmask_core::dispatch::{CullAnswer, CullOptions};
use pairmask_core::engine::CullError;
use pairmask_core::mask::ReadableEncodings;
use pairmask_core::objects::Objects;
use pairmask_core::repeat::Seen;
use pairmask_wire::{CullRequest, Reject, SentRules};

use super::Served;
use super::between::Sets;
use super::filtered::{self, Filtered, MaskFilters};
use crate::clients::GpuNeed;
use crate::execute::{
    BUNDLE_FRAMES, CullUnderWay, Ended, EnginePool, Executor, GpuShare, Joining, Owner,
    SUBMISSIONS_UNDER_WAY, Unserved,
};
use crate::publish::{OpenRequest, Outbox};

/// Engines for sessions that have none yet, and the frames that a GPU has not ended.
pub(super) struct Culls {
    /// Sessions get engines like these, which no session has.
    model: Mutex<Executor>,
    gpu: GpuShare,
    filters: MaskFilters,
    pool: Arc<EnginePool>,
    /// Submissions under way, oldest first.
    under_way: Mutex<VecDeque<Submission>>,
    /// Their number, for those who only look.
    under_way_count: AtomicUsize,
}

/// A frame, or several, that end together.
struct Submission {
    first: CullUnderWay<OpenRequest>,
    others: Vec<CullUnderWay<OpenRequest>>,
}

impl Culls {
    /// No frame yet. Sessions get engines like `model`.
    pub(super) fn new(model: Executor, pool: Arc<EnginePool>) -> Self {
        Self {
            gpu: model.gpu_share(),
            model: Mutex::new(model),
            filters: MaskFilters::default(),
            pool,
            under_way: Mutex::new(VecDeque::with_capacity(SUBMISSIONS_UNDER_WAY)),
            under_way_count: AtomicUsize::new(0),
        }
    }

    /// Whether a frame is under way.
    pub(super) fn is_busy(&self) -> bool {
        self.under_way_count.load(Ordering::Relaxed) > 0
    }

    /// Lets the engines work for a moment.
    pub(super) fn rest(&self) {
        self.gpu.rest();
    }

    /// Gives up what belonged to clients that are gone.
    pub(super) fn tidy(&self) {
        self.gpu.tidy();
        self.filters.tidy();
    }

    /// Answers a request, or leaves it under way.
    pub(super) fn take(
        &self,
        open: OpenRequest,
        request: &CullRequest,
        threads: usize,
        outbox: &Outbox,
    ) -> Served {
        let mut joining = Vec::new();
        // A submission that is under way need not be waited for: this thread can do more meanwhile.
        let joins = self.is_busy().then_some(&mut joining);
        let served = self.take_one(open, request, threads, joins, outbox);
        self.begin_bundle(joining, outbox);
        served
    }

    /// Answers several requests, or leaves them under way. Small frames for the GPU share a submission.
    /// An error is one that was served already.
    pub(super) fn take_bundle(
        &self,
        requests: impl IntoIterator<Item = Result<(OpenRequest, CullRequest), Served>>,
        threads: usize,
        outbox: &Outbox,
    ) -> Vec<Served> {
        let mut joining = Vec::with_capacity(BUNDLE_FRAMES);
        let mut take = |(open, request): (OpenRequest, CullRequest)| {
            if joining.len() == BUNDLE_FRAMES {
                self.begin_bundle(std::mem::take(&mut joining), outbox);
            }
            self.take_one(open, &request, threads, Some(&mut joining), outbox)
        };
        let served = requests.into_iter().map(|request| request.map_or_else(|s| s, &mut take));
        let served = served.collect();
        self.begin_bundle(joining, outbox);
        served
    }

    /// Answers a request, leaves it under way, or adds its frame to those that are `joining` others.
    fn take_one(
        &self,
        open: OpenRequest,
        request: &CullRequest,
        threads: usize,
        joining: Option<&mut Vec<Joining<OpenRequest>>>,
        outbox: &Outbox,
    ) -> Served {
        let session = open.sender().session;
        let kept = outbox.clients().take_engines(session);
        let mut engines = kept.unwrap_or_else(|| Box::new(self.new_engines()));
        // A client that is alone may have all of them.
        let beside_others = threads < self.pool.threads();
        let threads = request.threads.map_or(threads, |asked| asked.min(threads)).max(1);
        let options = CullOptions {
            engine: request.engine,
            encoding: request.encoding,
            threads: Some(threads),
            visit_threads: request.visit_threads,
            last_pairs: outbox.clients().last_pairs(session),
            readable: ReadableEncodings::at_minor(request.client_minor),
        };
        let way = Way { options, beside_others, joining };
        let cull = || self.cull(open, request, way, &mut engines, outbox);
        let used = match Place::of(&options) {
            Place::Lane => cull(),
            Place::Pool => self.pool.work(cull),
        };
        outbox.clients().keep_engines(session, engines);
        used
    }

    fn cull(
        &self,
        mut open: OpenRequest,
        request: &CullRequest,
        way: Way<'_>,
        engines: &mut Executor,
        outbox: &Outbox,
    ) -> Served {
        let Way { options, beside_others, joining } = way;
        let options = &options;
        if let Err(reject) = open.place_scene(request.scene) {
            outbox.refuse(&mut open, &reject.into());
            open.close();
            return Served::BEGUN;
        }
        let rules = match read_rules(&open, request, engines) {
            Ok(rules) => rules,
            Err(reject) => {
                outbox.refuse(&mut open, &reject.into());
                open.close();
                return Served::BEGUN;
            }
        };
        if let Some(first) = request.first_set {
            let sets = Sets { first, options, beside_others };
            return self.filters.cull_between(open, &sets, engines, outbox);
        }
        let sender = open.sender();
        let limit_words = open.limit_words();
        let mut seen = Seen::New;
        if request.may_repeat {
            let (objects, mut reply) = open.parts();
            let number = rules.as_ref().map_or(0, |rules| rules.number());
            seen = engines.repeats().look_with_rules(objects, options, number, &mut reply);
        }
        if let Seen::Answered(answer) = seen {
            open.note_world_ranges(&answer.report.shape, engines.repeats().words_behind());
            if let Some(rules) = rules {
                open.put_rules(rules, *options, true);
            }
            // The next frame is judged by the last one that was culled.
            return Served { is_frame: false, ..publish(open, Ok(answer), outbox) };
        }
        let is_alike = seen == Seen::Alike;
        if let Some(rules) = &rules {
            open.put_rules(Arc::clone(rules), *options, false);
        }
        let on_gpu = rules.as_ref().is_none_or(|rules| engines.may_use_gpu(rules, options));
        if let Some(rules) = rules.as_ref().filter(|_| !on_gpu) {
            let answer = filtered::cull_here(&mut open, engines, rules, options);
            if is_alike {
                open.keep_with(engines.repeats().ticket());
            }
            return publish(open, answer, outbox);
        }
        let boxes = match open.parts() {
            (Objects::Boxes(boxes), _) => boxes,
            (Objects::Spheres(spheres), mut reply) => {
                let answer = engines.cull_spheres(spheres, options, &mut reply);
                if is_alike {
                    open.keep_with(engines.repeats().ticket());
                }
                return publish(open, answer, outbox);
            }
        };
        let owner = Owner::Client(sender.port);
        let planned = if beside_others {
            engines.plan_beside_others(boxes, options, limit_words)
        } else {
            engines.plan(boxes, options, limit_words)
        };
        if let Some(rules) = rules.filter(|_| !planned.is_gpu()) {
            if is_alike {
                open.keep_with(engines.repeats().ticket());
            }
            let on_one_core = planned.on_one_core();
            let answer = filtered::cull_here(&mut open, engines, &rules, options);
            return Served { on_one_core, ..publish(open, answer, outbox) };
        }
        if is_alike && planned.is_sooner_compared(open.objects()) {
            open.keep_with(engines.repeats().ticket());
        }
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
        if engines.can_begin(&planned) {
            self.claim_place(Place::of(options), outbox);
            match engines.begin(planned, owner, open) {
                Ok(first) => {
                    self.under_way().push_back(Submission { first, others: Vec::new() });
                    Served { gpu, ..Served::BEGUN }
                }
                Err(ended) => {
                    self.under_way_count.fetch_sub(1, Ordering::Relaxed);
                    self.publish_all(ended, Place::of(options), outbox)
                }
            }
        } else {
            let on_one_core = planned.on_one_core();
            let answer = engines.run(planned, owner, &mut open);
            Served { on_one_core, gpu, ..self.finish(open, answer, Place::of(options), outbox) }
        }
    }

    /// Leaves frames to the GPU in one submission, if there are any.
    fn begin_bundle(&self, joining: Vec<Joining<OpenRequest>>, outbox: &Outbox) {
        if joining.is_empty() {
            return;
        }
        self.claim_place(Place::Lane, outbox);
        let (mut begun, mut unserved) = (Vec::with_capacity(joining.len()), Vec::new());
        for frame in self.gpu.begin_bundle(joining) {
            match frame {
                Ok(frame) => begun.push(frame),
                Err(frame) => unserved.push(frame),
            }
        }
        if begun.is_empty() {
            self.under_way_count.fetch_sub(1, Ordering::Relaxed);
        } else {
            let first = begun.remove(0);
            self.under_way().push_back(Submission { first, others: begun });
        }
        for frame in unserved {
            self.publish_all(self.answer(frame, Place::Lane), Place::Lane, outbox);
        }
    }

    /// Publishes the oldest frame under way if it has ended, and no other thread is about to. Whether it
    /// had.
    pub(super) fn publish_ended(&self, outbox: &Outbox) -> bool {
        if !self.is_busy() {
            return false;
        }
        let Ok(mut under_way) = self.under_way.try_lock() else { return false };
        if !under_way.front().is_some_and(|submission| submission.first.has_ended()) {
            return false;
        }
        let ended = under_way.pop_front();
        drop(under_way);
        if let Some(submission) = ended {
            self.end(submission, Place::Lane, outbox);
        }
        true
    }

    /// Claims one of the places for frames under way. Ends frames until one is free.
    fn claim_place(&self, place: Place, outbox: &Outbox) {
        let claimed = |count| (count < SUBMISSIONS_UNDER_WAY).then_some(count + 1);
        let count = &self.under_way_count;
        while count.fetch_update(Ordering::Relaxed, Ordering::Relaxed, claimed).is_err() {
            let oldest = self.under_way().pop_front();
            match oldest {
                Some(submission) => self.end(submission, place, outbox),
                // Other threads end them, or are about to begin theirs.
                None => std::thread::yield_now(),
            }
        }
    }

    fn end(&self, submission: Submission, place: Place, outbox: &Outbox) {
        let Submission { first, others } = submission;
        // Its workspaces are free when the last frame has ended.
        let frames = others.len() + 1;
        for (frame, number) in std::iter::once(first).chain(others).zip(1..) {
            let ended = self.gpu.end(frame);
            if number == frames {
                self.under_way_count.fetch_sub(1, Ordering::Relaxed);
            }
            let ended = ended.unwrap_or_else(|unserved| self.answer(unserved, place));
            self.publish_all(ended, place, outbox);
        }
    }

    /// Publishes what became of a frame. A device that hangs may keep the request: then its client's
    /// deadline ends its wait.
    fn publish_all(
        &self,
        (answer, open): Ended<OpenRequest>,
        place: Place,
        outbox: &Outbox,
    ) -> Served {
        open.map_or(Served::BEGUN, |open| self.finish(open, answer, place, outbox))
    }

    /// Publishes an answer that was found without the frame's rules, if it has any.
    fn finish(
        &self,
        mut open: OpenRequest,
        answer: Result<CullAnswer, CullError>,
        place: Place,
        outbox: &Outbox,
    ) -> Served {
        let finished = self.filters.finish(&mut open, answer, |work| match place {
            Place::Lane => self.pool.work(|| work(self.pool.threads())),
            Place::Pool => work(self.pool.threads()),
        });
        let answer = match finished {
            Filtered::Done(answer) => answer,
            Filtered::CullHere(rules, options) => {
                let mut engines = self.new_engines();
                let mut cull = || filtered::cull_here(&mut open, &mut engines, &rules, &options);
                match place {
                    Place::Lane if options.threads != Some(1) => self.pool.work(cull),
                    _ => cull(),
                }
            }
        };
        publish(open, answer, outbox)
    }

    /// Answers a frame that the GPU could not serve.
    fn answer(&self, unserved: Unserved<OpenRequest>, place: Place) -> Ended<OpenRequest> {
        let mut engines = self.new_engines();
        match place {
            Place::Lane if unserved.threads() != Some(1) => {
                self.pool.work(move || engines.answer(unserved))
            }
            _ => engines.answer(unserved),
        }
    }

    fn new_engines(&self) -> Executor {
        self.model.lock().unwrap_or_else(PoisonError::into_inner).beside()
    }

    fn under_way(&self) -> MutexGuard<'_, VecDeque<Submission>> {
        self.under_way.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How a frame is served.
struct Way<'a> {
    options: CullOptions,
    /// Whether other clients are busy.
    beside_others: bool,
    /// Frames that it may join.
    joining: Option<&'a mut Vec<Joining<OpenRequest>>>,
}

/// Where a thread is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// Outside of the pool's work: parallel engines have to be given to it.
    Lane,
    /// In the pool's work, which is not begun a second time from within.
    Pool,
}

impl Place {
    /// Where a frame of such options is culled.
    fn of(options: &CullOptions) -> Self {
        if options.threads == Some(1) { Self::Lane } else { Self::Pool }
    }
}

/// The rules of a request; `None` where it has none, or those let all boxes meet.
fn read_rules(
    open: &OpenRequest,
    request: &CullRequest,
    engines: &mut Executor,
) -> Result<Option<Arc<SentRules>>, Reject> {
    let Some(place) = &request.rules else { return Ok(None) };
    let rules = engines.read_rules(place, request.scene.count, open.pages())?;
    Ok((!rules.let_all_meet()).then_some(rules))
}

fn publish(
    mut open: OpenRequest,
    answer: Result<CullAnswer, CullError>,
    outbox: &Outbox,
) -> Served {
    let threads = answer.as_ref().map_or(1, |answer| answer.threads);
    match answer {
        Ok(answer) => {
            open.keep(&answer);
            outbox.answer(&mut open, answer);
        }
        Err(error) => outbox.refuse(&mut open, &error.into()),
    }
    open.close();
    Served { threads, ..Served::BEGUN }
}
