//! Requests that change a scene.

use std::sync::Arc;
use std::time::Instant;

use pairmask_core::dispatch::{CpuEngines, StageTimes};
use pairmask_core::engine::{AvailableIsa, CullError, ReplyBuffer};
use pairmask_core::plan::Calibration;
use pairmask_core::scene::{Edit, Reported, SceneError, SceneOptions};
use pairmask_core::{EngineChoice, EngineName};
use pairmask_transport::Counters;
use pairmask_wire::{
    EditScratch, ReplyFields, SceneAnswerLayout, SceneId, SceneRequest, TickMarks, TickNotes,
    response_scene, response_scene_ended,
};

use super::asked::Asked;
use super::{Served, threads_of};
use crate::audit::{Auditor, NotedName, SceneNote};
use crate::clients::{GpuNeed, PendingBoxes, SceneRoom, SceneTotals, SessionScene};
use crate::execute::{EnginePool, Gpus, SceneHost, is_left_to_cores};
use crate::publish::{OpenRequest, Outbox, Refusal};

#[derive(Clone)]
pub(super) struct SceneTools {
    pub(super) isa: AvailableIsa,
    pub(super) calibration: Calibration,
    pub(super) gpus: Gpus,
    pub(super) totals: SceneTotals,
    pub(super) pool: Arc<EnginePool>,
    pub(super) counters: Arc<Counters>,
    pub(super) auditor: Arc<Auditor>,
}

impl SceneTools {
    pub(super) fn new_scene(
        &self,
        most_boxes: u32,
        engine: EngineChoice,
    ) -> Result<SceneHost, CullError> {
        let options = SceneOptions::default().with_most_boxes(most_boxes);
        let engines = CpuEngines::on(self.isa, self.calibration);
        SceneHost::new(options, engines, self.gpus.for_scene(), engine)
    }
}

pub(super) struct SceneEdits {
    pub(super) tools: SceneTools,
    pub(super) outbox: Arc<Outbox>,
}

impl SceneEdits {
    pub(super) fn take(&self, open: OpenRequest, request: &SceneRequest, threads: usize) -> Served {
        let threads = threads_of(request.threads, threads);
        let found = self.find(&open, request);
        self.serve(open, found, threads, |kept, open| {
            // More would be found in memory that nobody has counted.
            kept.scene.limit_pairs(kept.room.most_pairs(open.limit_pairs()));
            let edit = || edit_and_answer(kept, open, request, threads, &self.outbox);
            let edited = self.tools.pool.work_by(threads, edit);
            if edited.is_err() {
                // What it was read into may be large.
                kept.scratch = EditScratch::default();
            }
            // A scene that did not begin is of no use to the client: it sends the scene again.
            edited.map_err(|failed| match failed {
                Failed::Refused(refusal) if request.base == 0 => Failed::Lost(refusal),
                failed => failed,
            })
        })
    }

    /// Answers a query or a cast.
    pub(super) fn ask(
        &self,
        open: OpenRequest,
        asked: Asked<'_>,
        revision: u64,
        threads: usize,
    ) -> Served {
        let threads = threads_of(asked.threads(), threads);
        let session = open.sender.session;
        let found = self.find_at(session, asked.scene(), revision);
        self.serve(open, found, threads, |kept, open| {
            // A scene in video memory has work for the pool only where its queries fill a copy of several
            // threads. Else a thread of it would be woken for nothing.
            let are_few = asked.is_of_gpu(&kept.scene) && asked.count() <= FEW_QUERIES;
            let answer = || {
                let SessionScene { scene, scratch, found, room, audited, .. } = kept;
                let of = (&mut *scene, &mut *found, audited.as_ref());
                let answered = asked.answer(of, open, threads, &self.outbox);
                room.note(scene, bytes_of(found) + scratch.allocated_bytes() as u64);
                answered
            };
            self.tools.pool.work_by(if are_few { 1 } else { threads }, answer)
        })
    }

    fn serve(
        &self,
        mut open: OpenRequest,
        found: Result<SessionScene, Refusal>,
        threads: usize,
        work: impl FnOnce(&mut SessionScene, &mut OpenRequest) -> Result<(), Failed>,
    ) -> Served {
        let mut gpu = GpuNeed::None;
        let done = found.and_then(|mut kept| {
            kept.scene.set_asker(Some(open.asker()));
            let done = work(&mut kept, &mut open);
            kept.scene.set_asker(None);
            if kept.scene.engine().is_gpu() {
                gpu = GpuNeed::Alone;
            }
            if !matches!(done, Err(Failed::Lost(_))) {
                self.outbox.clients.of(open.sender.session, |client| client.scenes.push(kept));
            }
            done.map_err(|(Failed::Refused(refusal) | Failed::Lost(refusal))| refusal)
        });
        if let Err(refusal) = &done {
            self.outbox.refuse(&mut open, refusal);
        }
        drop(open);
        Served { threads, on_gpu: gpu != GpuNeed::None, gpu, ..Served::BEGUN }
    }

    pub(super) fn end(&self, open: &mut OpenRequest, scene: SceneId) {
        drop(self.outbox.clients.take_scene(open.sender.session, scene));
        let header = response_scene_ended(&open.fields);
        open.send(&header);
    }

    fn find(&self, open: &OpenRequest, request: &SceneRequest) -> Result<SessionScene, Refusal> {
        let session = open.sender.session;
        if request.base == 0 {
            drop(self.outbox.clients.take_scene(session, request.scene));
            let scene = self.tools.new_scene(request.most_boxes, request.engine)?;
            let audited = self.outbox.auditor.draw_scene(request.most_boxes);
            let counts = self.tools.counters.scene(session, request.scene.0.into());
            return Ok(SessionScene {
                id: request.scene,
                revision: 0,
                scene,
                scratch: EditScratch::default(),
                found: Vec::new(),
                room: SceneRoom::begin(&self.tools.totals, open.share(), counts)?,
                audited,
            });
        }
        self.find_at(session, request.scene, request.base)
    }

    pub(super) fn find_at(
        &self,
        session: u64,
        scene: SceneId,
        revision: u64,
    ) -> Result<SessionScene, Refusal> {
        match self.outbox.clients.take_scene(session, scene) {
            Some(kept) if kept.revision == revision => Ok(kept),
            kept => {
                let revision = kept.as_ref().map_or(0, |kept| kept.revision);
                if let Some(kept) = kept {
                    self.outbox.clients.of(session, |client| client.scenes.push(kept));
                }
                Err(Refusal::stale_scene(revision))
            }
        }
    }
}

fn edit_and_answer(
    kept: &mut SessionScene,
    open: &mut OpenRequest,
    request: &SceneRequest,
    threads: usize,
    outbox: &Outbox,
) -> Result<(), Failed> {
    let SessionScene { revision, scene, scratch, found, room, audited, .. } = kept;
    let start = Instant::now();
    let _copy = open.charge_copy()?;
    let steps = scratch.read(request, open.pages())?;
    let edit = Edit { steps: &steps };
    let moved = edit.boxes() as u64;
    room.make(scene, edit, PendingBoxes::default(), bytes_of(found))?;
    let ingested = Instant::now();
    if request.is_acknowledged {
        scene.acknowledge();
    }
    if request.is_lost {
        scene.resync();
    }
    scene.set_threads(threads);
    let edited = scene.edit(edit, request.report);
    room.note(scene, bytes_of(found) + scratch.allocated_bytes() as u64);
    match edited {
        Ok(()) => *revision = request.revision,
        // The scene is what it was.
        Err(SceneError::Edit(error)) => return Err(error.into()),
        // Its boxes are lost with the device's memory: the client sends them again.
        Err(SceneError::Cull(error)) if is_left_to_cores(&error) => {
            return Err(Failed::Lost(Refusal::stale_scene(0)));
        }
        Err(SceneError::Cull(error)) => return Err(Failed::Lost(error.into())),
        Err(error) => return Err(Failed::Lost(Refusal::engine_failed(&error))),
    }
    if let Some(pair_count) = request.reported {
        scene.mark_reported(pair_count);
    }
    let executed = Instant::now();

    let ns = |from: Instant, to: Instant| to.duration_since(from).as_nanos() as u64;
    let times = StageTimes {
        ingest_ns: ns(start, ingested),
        execute_ns: ns(ingested, executed),
        ..StageTimes::default()
    };
    let (engine, bytes) = (scene.engine(), scene.bytes());
    let boxes = scene.len() as u64;
    let answer = EditAnswer { engine, bytes, boxes, threads, times };
    let reported = scene.reported();
    room.counts().note_edit((moved, boxes), reported.pair_count(), engine, &times);
    answer.send(open, reported, None, outbox).map_err(Failed::Lost)?;
    if let Some(audited) = audited {
        // Its payload is ours to read as long as the request is.
        let ReplyFields { client_token, frame, .. } = open.fields;
        let name = NotedName::Request { client_token, frame };
        let note = || {
            let (payload, reported) = (open.pages().to_vec(), reported.clone());
            Some(SceneNote { name, request: *request, payload, reported })
        };
        outbox.auditor.follow(audited, note);
    }
    Ok(())
}

pub(super) struct EditAnswer {
    pub engine: EngineName,
    pub bytes: u64,
    /// In the scene.
    pub boxes: u64,
    pub threads: usize,
    pub times: StageTimes,
}

impl EditAnswer {
    /// Answers with what is reported, and with what a tick has beside that.
    pub fn send(
        &self,
        open: &mut OpenRequest,
        reported: &Reported,
        tick: Option<TickNotes<'_>>,
        outbox: &Outbox,
    ) -> Result<(), Refusal> {
        let publish = Instant::now();
        let layout = SceneAnswerLayout::of(reported);
        let marks = tick.map(|notes| (TickMarks::after(&layout, &notes), notes));
        let words = marks.as_ref().map_or(layout.words(), |(marks, _)| marks.words());
        let (_, mut reply) = open.parts();
        let words = reply.reserve(words).map_err(CullError::from)?;
        layout.write(reported, words);
        if let Some((marks, notes)) = &marks {
            marks.write(notes, words);
        }
        let times = StageTimes {
            publish_ns: publish.elapsed().as_nanos() as u64,
            total_ns: open.taken_at.elapsed().as_nanos() as u64,
            ..self.times
        };
        let Self { engine, bytes, boxes, threads, .. } = *self;
        let header = response_scene(&open.fields, engine, threads, reported, bytes, &times);
        outbox.count_edit(open, reported, boxes, (engine, threads, times));
        open.send(&marks.map_or(header, |(marks, _)| marks.mark(header)));
        Ok(())
    }
}

pub(super) enum Failed {
    /// The scene is what it was.
    Refused(Refusal),
    /// The scene is lost, or of no use to its client: an edit was applied whose answer is lost.
    Lost(Refusal),
}

impl<E: Into<Refusal>> From<E> for Failed {
    fn from(error: E) -> Self {
        Self::Refused(error.into())
    }
}

/// Most queries of a scene in video memory that are answered without the pool: 24 bytes each, so that the copy
/// to where the GPU sees them is one thread's.
const FEW_QUERIES: u32 = 1 << 15;

pub(super) const fn bytes_of(found: &Vec<[u32; 2]>) -> u64 {
    (found.capacity() * size_of::<[u32; 2]>()) as u64
}
