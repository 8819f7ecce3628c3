//! Where answers go out: counted, sent, their client woken, some of them checked again.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use pairmask_core::dispatch::{CullAnswer, StageTimes};
use pairmask_core::engine::CullReport;
use pairmask_core::scene::{QueryFilterData, Reported};
use pairmask_core::{BoxCount, BoxForm, EngineName, ObjectForm};
use pairmask_transport::{
    Answered, AnsweredOf, AnsweredTotals, Counters, Door, GpuCounts, StatusFile,
};
use pairmask_wire::{
    AuditCounts, LAST_ERRORS, RecordedError, ReplyFields, ResponseHeader, SkipTotals, StatusBody,
    StatusCode, response_error, response_ok,
};

use super::{OpenRequest, Refusal};
use crate::audit::{AuditedFrame, AuditedScene, Auditor, Window};
use crate::clients::{Clients, SceneTotals};
use crate::locked;
use crate::requests::Served;

/// What changes the words of a finished answer and their report. A daemon that serves clients has
/// none: tests show with it that the auditor notices a wrong answer.
pub type AlterAnswer = fn(&mut [u32], &mut CullReport);

pub(crate) struct Outbox {
    door: Arc<Door>,
    pub(crate) clients: Clients,
    tally: Mutex<Tally>,
    pub(crate) auditor: Arc<Auditor>,
    scenes: SceneTotals,
    alter_answers: Option<AlterAnswer>,
}

impl Outbox {
    pub(crate) fn new(
        door: Arc<Door>,
        clients: Clients,
        auditor: Arc<Auditor>,
        scenes: SceneTotals,
        alter_answers: Option<AlterAnswer>,
    ) -> Self {
        let body = StatusBody { pid: std::process::id(), ..StatusBody::default() };
        let (start, skips) = (Instant::now(), SkipTotals::default());
        let tally = Mutex::new(Tally { start, body, skips, shown: Arc::clone(door.counters()) });
        Self { door, clients, tally, auditor, scenes, alter_answers }
    }

    pub(crate) fn sessions(&self) -> Vec<u64> {
        self.door.sessions()
    }

    pub(crate) fn counters(&self) -> &Counters {
        self.door.counters()
    }

    pub(crate) fn status(&self) -> StatusBody {
        let (clients, audit) = (self.door.client_count(), self.auditor.counts());
        locked(&self.tally).body(clients, audit, self.scenes.get())
    }

    pub(crate) fn status_file(&self, gpus: GpuCounts) -> StatusFile {
        let skips = locked(&self.tally).skips;
        StatusFile::now(self.status(), skips, gpus)
    }

    /// Answers with the mask in the reply: of pairs of one and the other set, where there are two.
    pub(crate) fn answer(
        &self,
        open: &mut OpenRequest,
        first_set: Option<BoxCount>,
        mut answer: CullAnswer,
    ) {
        self.alter(open, &mut answer);
        let (fields, form) = (open.fields, open.objects().form());
        let (shape, reply) = (&answer.report.shape, open.words());
        let frame = AuditedFrame { form, first_set, scene: None, shape, reply };
        let is_test = self.door.is_supervisor(open.sender.process);
        let audited = if is_test { None } else { self.auditor.draw(&fields, &frame) };
        if first_set.is_none() {
            // What an engine without rules will find in the next frame.
            let found_pairs = open.rules.as_ref().and_then(|rules| rules.found_pairs);
            let found_pairs = found_pairs.unwrap_or(answer.report.pair_count);
            self.clients.of(open.sender.session, |client| {
                client.last_pairs = Some(found_pairs);
                // Its engines are away while they plan its next frame, or run this one.
                if let Some(engines) = &mut client.engines {
                    engines.executor.note_gpu(fields.box_count, &answer);
                }
            });
        }
        let of = AnsweredOf::Frame;
        let mut header = self.count(open, (fields.box_count, form, of), &answer);
        if let Some(span) = open.world_ranges {
            header.put_world_ranges(span);
        }
        open.send(&header);
        if let Some(window) = audited {
            // The objects are ours to read as long as the request is.
            let rules = open.rules.as_ref().map(|rules| Arc::clone(&rules.sent));
            self.auditor.submit(window, open.objects(), rules, &QueryFilterData::None);
        }
    }

    /// Answers a query with the mask in the reply. Returns what is to be audited of it.
    pub(crate) fn answer_query(
        &self,
        open: &mut OpenRequest,
        queries: BoxCount,
        mut answer: CullAnswer,
        scene: Option<&AuditedScene>,
    ) -> Option<Box<Window>> {
        self.alter(open, &mut answer);
        let form = ObjectForm::Boxes(BoxForm::F32);
        let (first_set, shape, reply) = (Some(queries), &answer.report.shape, open.words());
        let frame = AuditedFrame { form, first_set, scene, shape, reply };
        let audited = scene.and_then(|_| self.auditor.draw(&open.fields, &frame));
        let header = self.count(open, (queries, form, AnsweredOf::Query), &answer);
        open.send(&header);
        audited
    }

    fn alter(&self, open: &mut OpenRequest, answer: &mut CullAnswer) {
        if let Some(alter) = self.alter_answers {
            alter(open.words_mut(), &mut answer.report);
        }
    }

    fn count(
        &self,
        open: &OpenRequest,
        (objects, form, of): (BoxCount, ObjectForm, AnsweredOf),
        answer: &CullAnswer,
    ) -> ResponseHeader {
        let (fields, report) = (&open.fields, &answer.report);
        let total_ns = open.taken_at.elapsed().as_nanos() as u64;
        let times = StageTimes { total_ns, ..answer.times };
        if !self.door.is_supervisor(open.sender.process) {
            let counted = ReplyFields { box_count: objects, ..*fields };
            let skips = SkipTotals::of_frame(&report.skipped);
            locked(&self.tally).note_frame(&counted, form, report.pair_count, &skips);
            let (engine, threads) = (answer.engine, answer.threads);
            let found = Found { pairs: report.pair_count, engine, threads, times };
            open.counts().note_answered(&found.counted(&counted, of));
        }
        response_ok(fields, answer.engine, answer.threads, report, &times)
    }

    /// Counts what an edit of a scene is answered with, which has so many boxes now.
    pub(crate) fn count_edit(
        &self,
        open: &OpenRequest,
        reported: &Reported,
        boxes: u64,
        (engine, threads, times): (EngineName, usize, StageTimes),
    ) {
        let pairs =
            (reported.begun().len() + reported.ended().len() + reported.pairs().len()) as u64;
        let skips = SkipTotals::of_scene(reported.skipped(), reported.pair_count(), pairs);
        let (fields, form) = (&open.fields, ObjectForm::Boxes(BoxForm::F32));
        locked(&self.tally).note_frame(fields, form, pairs, &skips);
        let of = AnsweredOf::Edit { boxes, pairs: reported.pair_count() };
        let found = Found { pairs, engine, threads, times };
        open.counts().note_answered(&found.counted(fields, of));
    }

    /// Counts what a cast is answered with.
    pub(crate) fn count_cast(&self, open: &OpenRequest, found: &Found) {
        let (fields, form) = (&open.fields, ObjectForm::Boxes(BoxForm::F32));
        locked(&self.tally).note_frame(fields, form, found.pairs, &SkipTotals::default());
        open.counts().note_answered(&found.counted(fields, AnsweredOf::Query));
    }

    /// Answers with an error, and counts it, where somebody waits for the answer.
    pub(crate) fn refuse(&self, open: &mut OpenRequest, refusal: &Refusal) {
        let over = match refusal {
            Refusal { status: StatusCode::ReplyTooLarge, detail: [needed, _], .. } => {
                open.over_budget(*needed)
            }
            _ => None,
        };
        let over = over.map(Refusal::from);
        let refusal = over.as_ref().unwrap_or(refusal);
        let fields = open.fields;
        if !open.is_wanted() {
            log::debug!("client {:016x} waits no more: {}", fields.client_token, refusal.text);
            return;
        }
        log::debug!("client {:016x}: {}", fields.client_token, refusal.text);
        locked(&self.tally).note_error(&fields, refusal.status);
        open.counts().note_error();
        open.send(&response_error(&fields, refusal.status, refusal.detail));
    }

    /// The same, and gives the request back.
    pub(crate) fn refuse_and_close(&self, open: OpenRequest, refusal: Refusal) -> Served {
        self.send_and_close(open, Err(refusal));
        Served::BEGUN
    }

    pub(crate) fn send_and_close(
        &self,
        mut open: OpenRequest,
        header: Result<ResponseHeader, Refusal>,
    ) {
        match header {
            Ok(header) => open.send(&header),
            Err(refusal) => self.refuse(&mut open, &refusal),
        }
        drop(open);
    }
}

/// What an answer was found by.
#[derive(Clone, Copy)]
pub(crate) struct Found {
    /// Pairs or hits.
    pub pairs: u64,
    pub engine: EngineName,
    pub threads: usize,
    pub times: StageTimes,
}

impl Found {
    fn counted(&self, fields: &ReplyFields, of: AnsweredOf) -> Answered {
        let Self { pairs, engine, threads, times } = *self;
        let (token, objects) = (fields.client_token, fields.box_count.get().into());
        Answered { token, objects, pairs, of, engine, threads, times }
    }
}

/// All answers so far.
struct Tally {
    start: Instant,
    body: StatusBody,
    skips: SkipTotals,
    /// Where the numbers are seen as they change.
    shown: Arc<Counters>,
}

impl Tally {
    fn note_frame(
        &mut self,
        fields: &ReplyFields,
        form: ObjectForm,
        pair_count: u64,
        skips: &SkipTotals,
    ) {
        self.skips = self.skips.plus(skips);
        self.body.frames += 1;
        let objects = match form {
            ObjectForm::Boxes(_) => &mut self.body.boxes,
            ObjectForm::Spheres => &mut self.body.spheres,
        };
        *objects += u64::from(fields.box_count.get());
        self.body.pairs = self.body.pairs.saturating_add(pair_count);
        self.show();
    }

    fn show(&self) {
        let StatusBody { frames, boxes, spheres, pairs, errors, .. } = self.body;
        self.shown.note_answered(AnsweredTotals { frames, boxes, spheres, pairs, errors });
    }

    /// Counts a refusal, and keeps it among the last ones.
    fn note_error(&mut self, fields: &ReplyFields, status: StatusCode) {
        self.body.errors += 1;
        self.body.last_errors.copy_within(..LAST_ERRORS - 1, 1);
        self.body.last_errors[0] = RecordedError {
            client_token: fields.client_token,
            frame: fields.frame,
            at_ns: self.start.elapsed().as_nanos() as u64,
            status: status as u32,
            reserved: 0,
        };
        self.show();
    }

    fn body(
        &self,
        client_count: usize,
        audit: AuditCounts,
        (scenes, scene_bytes): (u64, u64),
    ) -> StatusBody {
        let cut = |number: u64| u32::try_from(number).unwrap_or(u32::MAX);
        StatusBody {
            client_count: u32::try_from(client_count).unwrap_or(u32::MAX),
            uptime_ns: self.start.elapsed().as_nanos() as u64,
            audit,
            scenes: cut(scenes),
            scene_mib: cut(scene_bytes.div_ceil(1 << 20)),
            ..self.body
        }
    }
}
