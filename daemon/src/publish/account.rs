//! What the daemon has done so far.

use std::time::Instant;

use pairmask::units::BoxCount;
use pairmask::wire::{LAST_ERRORS, RecordedError, ReplyFields, StatusBody, StatusCode};

/// Counters since the worker began to serve.
pub(super) struct Account {
    start: Instant,
    body: StatusBody,
}

impl Account {
    pub(super) fn new() -> Self {
        let body = StatusBody { pid: std::process::id(), ..StatusBody::default() };
        Self { start: Instant::now(), body }
    }

    pub(super) const fn note_frame(&mut self, boxes: BoxCount, pair_count: u64) {
        self.body.frames += 1;
        self.body.boxes += boxes.get() as u64;
        self.body.pairs = self.body.pairs.saturating_add(pair_count);
    }

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

    pub(super) fn body(&self, client_count: usize) -> StatusBody {
        StatusBody {
            client_count: u32::try_from(client_count).unwrap_or(u32::MAX),
            uptime_ns: self.start.elapsed().as_nanos() as u64,
            ..self.body
        }
    }
}
