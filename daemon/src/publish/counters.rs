//! Counters of what the daemon has done so far.

use std::time::Instant;

use pairmask_core::objects::ObjectForm;
use pairmask_wire::{
    AuditCounts, LAST_ERRORS, RecordedError, ReplyFields, SkipTotals, StatusBody, StatusCode,
};

/// Counters since the worker began to serve.
pub(super) struct Counters {
    start: Instant,
    body: StatusBody,
    skips: SkipTotals,
}

impl Counters {
    /// All zero; time counts from now.
    pub(super) fn new() -> Self {
        let body = StatusBody { pid: std::process::id(), ..StatusBody::default() };
        Self { start: Instant::now(), body, skips: SkipTotals::default() }
    }

    /// Counts an answer.
    pub(super) fn note_frame(&mut self, fields: &ReplyFields, form: ObjectForm, pair_count: u64) {
        self.body.frames += 1;
        let objects = match form {
            ObjectForm::Boxes(_) => &mut self.body.boxes,
            ObjectForm::Spheres => &mut self.body.spheres,
        };
        *objects += u64::from(fields.box_count.get());
        self.body.pairs = self.body.pairs.saturating_add(pair_count);
    }

    /// Adds what an answer left out.
    pub(super) fn note_skips(&mut self, skips: &SkipTotals) {
        self.skips = self.skips.plus(skips);
    }

    /// What all answers left out.
    pub(super) const fn skips(&self) -> SkipTotals {
        self.skips
    }

    /// Counts a refusal, and keeps it among the last ones.
    pub(super) fn note_error(&mut self, fields: &ReplyFields, status: StatusCode) {
        self.body.errors += 1;
        self.body.last_errors.copy_within(..LAST_ERRORS - 1, 1);
        self.body.last_errors[0] = RecordedError {
            client_token: fields.client_token,
            frame: fields.frame,
            at_ns: self.start.elapsed().as_nanos() as u64,
            status: status as u32,
            reserved: 0,
        };
    }

    /// The counters, beside what others count.
    pub(super) fn body(
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
