//! Requests that change a scene.

use std::sync::Arc;
use std::time::Instant;

use pairmask_core::dispatch::{CpuEngines, StageTimes};
use pairmask_core::engine::{AvailableIsa, CullError, ReplyBuffer};
use pairmask_core::plan::Calibration;
use pairmask_core::scene::{BeyondMask, Edit, QueryError, SceneError, SceneOptions};
use pairmask_core::{BoxCount, EngineChoice};
use pairmask_wire::{
    EditScratch, QueryRequest, Reject, SceneAnswerLayout, SceneId, SceneRequest, response_scene,
    response_scene_ended,
};

use super::Served;
use crate::audit::{Auditor, SceneNote};
use crate::clients::{GpuNeed, KeptScene, PendingBoxes, SceneMemory};
use crate::execute::{EnginePool, Gpus, SceneKeeper};
use crate::publish::{OpenRequest, Outbox, Refusal};

/// What scenes are made and changed with.
#[derive(Clone)]
pub(super) struct SceneTools {
    pub(super) isa: AvailableIsa,
    pub(super) calibration: Calibration,
    pub(super) gpus: Gpus,
    /// What all scenes together may take.
    pub(super) memory: SceneMemory,
    pub(super) pool: Arc<EnginePool>,
    pub(super) auditor: Arc<Auditor>,
}

impl SceneTools {
    /// A scene without boxes.
    pub(super) fn new_scene(
        &self,
        most_boxes: u32,
        engine: EngineChoice,
    ) -> Result<SceneKeeper, CullError> {
        let options = SceneOptions::default().with_most_boxes(most_boxes);
        let engines = CpuEngines::on(self.isa, self.calibration);
        SceneKeeper::new(options, engines, self.gpus.for_scene(), engine)
    }
}

/// Scenes of one session.
pub(super) struct SceneEdits(pub(super) SceneTools);

impl SceneEdits {
    /// Answers an edit.
    pub(super) fn take(
        &self,
        mut open: OpenRequest,
        request: &SceneRequest,
        threads: usize,
        outbox: &Outbox,
    ) -> Served {
        let threads = request.threads.map_or(threads, |asked| asked.min(threads)).max(1);
        let session = open.sender().session;
        let mut gpu = GpuNeed::None;
        let edited = match self.find(session, request, outbox) {
            Ok(mut kept) => {
                // More would be found in memory that nobody has counted.
                let most_pairs = self.0.memory.most_pairs(open.limit_pairs());
                kept.scene.limit_pairs(most_pairs);
                let edited = if threads == 1 {
                    edit_and_answer(&mut kept, &mut open, request, 1, outbox)
                } else {
                    self.0
                        .pool
                        .work(|| edit_and_answer(&mut kept, &mut open, request, threads, outbox))
                };
                if kept.scene.engine().is_gpu() {
                    gpu = GpuNeed::Alone;
                }
                if edited.is_err() {
                    // What it was read into may be large, and nothing was charged for it.
                    kept.scratch = EditScratch::default();
                }
                // What was applied without an answer is of no use to the client, and neither is a scene that did not
                // begin: it sends the scene again.
                let begins = request.base == 0;
                if edited.is_ok() || !begins && matches!(edited, Err(Failed::Refused(_))) {
                    outbox.clients().keep_scene(session, kept);
                }
                edited.map_err(|failed| match failed {
                    Failed::Refused(refusal) | Failed::Applied(refusal) => refusal,
                })
            }
            Err(refusal) => Err(refusal),
        };
        if let Err(refusal) = &edited {
            outbox.refuse(&mut open, refusal);
        }
        open.close();
        Served { threads, on_gpu: gpu != GpuNeed::None, gpu, ..Served::BEGUN }
    }

    /// Forgets a scene.
    pub(super) fn end(open: &mut OpenRequest, scene: SceneId, outbox: &Outbox) {
        drop(outbox.clients().take_scene(open.sender().session, scene));
        let header = response_scene_ended(open.fields());
        outbox.send(open, &header);
    }

    /// The scene that an edit is for, taken from where it is kept.
    fn find(
        &self,
        session: u128,
        request: &SceneRequest,
        outbox: &Outbox,
    ) -> Result<KeptScene, Refusal> {
        if request.base == 0 {
            drop(outbox.clients().take_scene(session, request.scene));
            let scene = self.0.new_scene(request.most_boxes, request.engine)?;
            let audited = outbox.auditor.draw_scene(request.most_boxes);
            return Ok(KeptScene::begin(request.scene, scene, audited, &self.0.memory)?);
        }
        Self::find_at(session, request.scene, request.base, outbox)
    }

    /// A scene at a revision, taken from where it is kept.
    pub(super) fn find_at(
        session: u128,
        scene: SceneId,
        revision: u64,
        outbox: &Outbox,
    ) -> Result<KeptScene, Refusal> {
        match outbox.clients().take_scene(session, scene) {
            Some(kept) if kept.revision == revision => Ok(kept),
            kept => {
                let revision = kept.as_ref().map_or(0, |kept| kept.revision);
                if let Some(kept) = kept {
                    outbox.clients().keep_scene(session, kept);
                }
                Err(Refusal::stale_scene(revision))
            }
        }
    }
}

/// Applies an edit and answers.
fn edit_and_answer(
    kept: &mut KeptScene,
    open: &mut OpenRequest,
    request: &SceneRequest,
    threads: usize,
    outbox: &Outbox,
) -> Result<(), Failed> {
    let KeptScene { revision, scene, scratch, found, room, audited, .. } = kept;
    let start = Instant::now();
    let steps = scratch.read(request, open.pages())?;
    let edit = Edit { steps: &steps };
    room.make(scene, edit, PendingBoxes::default(), bytes_of(found))?;
    let ingested = Instant::now();
    if request.is_taken {
        scene.take();
    }
    if request.is_lost {
        scene.lose();
    }
    scene.set_threads(threads);
    let edited = scene.edit(edit, request.want);
    room.note(scene, bytes_of(found) + scratch.allocated_bytes() as u64);
    match edited {
        Ok(()) => *revision = request.revision,
        // The scene is what it was.
        Err(SceneError::Edit(error)) => return Err(error.into()),
        // Its boxes are gone with the device's memory: the client sends them again.
        Err(SceneError::Cull(
            CullError::DeviceLost { .. }
            | CullError::DeviceMemory { .. }
            | CullError::TooCrowded { .. },
        )) => return Err(Failed::Applied(Refusal::stale_scene(0))),
        Err(SceneError::Cull(error)) => return Err(Failed::Applied(error.into())),
        Err(error) => return Err(Failed::Applied(Refusal::engine_failed(&error))),
    }
    let executed = Instant::now();

    let layout = SceneAnswerLayout::of(scene.told());
    let (_, mut reply) = open.parts();
    let reserved = reply.reserve(layout.words());
    layout.write(scene.told(), reserved.map_err(|e| Failed::Applied(CullError::from(e).into()))?);
    let ns = |from: Instant, to: Instant| to.duration_since(from).as_nanos() as u64;
    let times = StageTimes {
        ingest_ns: ns(start, ingested),
        execute_ns: ns(ingested, executed),
        publish_ns: executed.elapsed().as_nanos() as u64,
        total_ns: open.taken_at().elapsed().as_nanos() as u64,
        ..StageTimes::default()
    };
    let told = scene.told();
    let kept_bytes = scene.bytes();
    let engine = scene.engine();
    let header = response_scene(open.fields(), engine, threads, told, kept_bytes, &times);
    outbox.count_edit(open.fields(), told);
    outbox.send(open, &header);
    if let Some(audited) = audited {
        // Its payload is ours to read as long as the request is.
        let named = (open.fields().client_token, open.fields().frame);
        let note = || Some(SceneNote::new(named, request, open.pages(), told));
        outbox.auditor.follow(audited, note);
    }
    Ok(())
}

/// Why an edit has no answer.
enum Failed {
    /// It was not applied.
    Refused(Refusal),
    /// It was, and its answer is lost.
    Applied(Refusal),
}

impl<E: Into<Refusal>> From<E> for Failed {
    fn from(error: E) -> Self {
        Self::Refused(error.into())
    }
}

/// Most pairs whose memory a scene keeps between queries: 8 MiB, 2,048 pages. To find more takes far longer than
/// to map their memory.
const MOST_KEPT_PAIRS: usize = 1 << 20;

/// Most queries of a scene in video memory that are answered without the pool: 24 bytes each, so that the copy
/// to where the GPU sees them is one thread's.
const FEW_QUERIES: u32 = 1 << 15;

impl SceneEdits {
    /// Answers a query.
    pub(super) fn query(
        &self,
        mut open: OpenRequest,
        request: &QueryRequest,
        threads: usize,
        outbox: &Outbox,
    ) -> Served {
        let threads = request.threads.map_or(threads, |asked| asked.min(threads)).max(1);
        let session = open.sender().session;
        let mut gpu = GpuNeed::None;
        let answered = match Self::find_at(session, request.scene, request.revision, outbox) {
            Ok(mut kept) => {
                let is_there = kept.scene.engine().is_gpu();
                let mut answer =
                    || query_and_answer(&mut kept, &mut open, request, threads, outbox);
                // A scene in video memory has work for the pool only where its queries fill a copy of several
                // threads. Else a thread of it would be woken for nothing.
                let answered =
                    if threads == 1 || (is_there && request.mask.queries() <= FEW_QUERIES) {
                        answer()
                    } else {
                        self.0.pool.work(answer)
                    };
                if is_there {
                    gpu = GpuNeed::Alone;
                }
                // Its boxes are gone with the device's memory: the client sends them again.
                let is_lost = matches!(answered, Err(Unanswered::Lost));
                if !is_lost {
                    outbox.clients().keep_scene(session, kept);
                }
                answered.map_err(|why| match why {
                    Unanswered::Lost => Refusal::stale_scene(0),
                    Unanswered::Refused(refusal) => refusal,
                })
            }
            Err(refusal) => Err(refusal),
        };
        if let Err(refusal) = &answered {
            outbox.refuse(&mut open, refusal);
        }
        open.close();
        Served { threads, on_gpu: gpu != GpuNeed::None, gpu, ..Served::BEGUN }
    }
}

/// Bytes that found pairs take.
const fn bytes_of(found: &Vec<[u32; 2]>) -> u64 {
    (found.capacity() * size_of::<[u32; 2]>()) as u64
}

/// Why a query has no answer.
enum Unanswered {
    Refused(Refusal),
    /// The scene was in video memory that is gone.
    Lost,
}

impl From<QueryError> for Unanswered {
    fn from(error: QueryError) -> Self {
        match error {
            QueryError::Cull(CullError::DeviceLost { .. }) => Self::Lost,
            QueryError::Cull(error) => Self::Refused(error.into()),
            // Whether there are enough tags was checked with the header.
            _ => Self::Refused(Reject::Query { field: "tags" }.into()),
        }
    }
}

fn query_and_answer(
    kept: &mut KeptScene,
    open: &mut OpenRequest,
    request: &QueryRequest,
    threads: usize,
    outbox: &Outbox,
) -> Result<(), Unanswered> {
    let KeptScene { scene, scratch, found, room, audited, .. } = kept;
    scene.set_threads(threads);
    scene.limit_query_pairs(open.limit_pairs());
    let taken_at = open.taken_at();
    let begun = Instant::now();
    let answer = {
        let (pages, mut reply) = open.payload_and_reply();
        let malformed = || Unanswered::Refused(Reject::Query { field: "payload" }.into());
        let (queries, tags) = request.read(pages).ok_or_else(malformed)?;
        request.mask.answer(queries, request.encoding, threads, found, &mut reply, |found| {
            scene.query(queries, tags, found).map_err(Unanswered::from)
        })
    };
    if found.capacity() > MOST_KEPT_PAIRS {
        *found = Vec::new();
    }
    room.note(scene, bytes_of(found) + scratch.allocated_bytes() as u64);
    let mut answer = answer?;
    answer.engine = scene.engine();
    answer.times.ingest_ns = begun.duration_since(taken_at).as_nanos() as u64;
    let queries = BoxCount::new(request.mask.queries());
    let window = outbox.answer_query(open, queries, answer, audited.as_ref());
    if let (Some(scene), Some(window)) = (audited, window)
        && let Some((queries, tags)) = request.read(open.pages())
    {
        outbox.auditor.submit_query(scene, window, queries, &tags);
    }
    Ok(())
}

impl From<BeyondMask> for Unanswered {
    fn from(_: BeyondMask) -> Self {
        Self::Refused(Reject::Query { field: "object count" }.into())
    }
}

impl From<CullError> for Unanswered {
    fn from(error: CullError) -> Self {
        Self::Refused(error.into())
    }
}
