//! What the daemon has done so far.

use std::time::Instant;

use pairmask::wire::{
    AuditCounts, LAST_ERRORS, ObjectForm, RecordedError, ReplyFields, StatusBody, StatusCode,
};

/// Counters since the worker began to serve.
pub(super) struct Account {
    start: Instant,
    body: StatusBody,
    /// Pairs in the last frame of each session, for the plan of its next.
    last_pairs: Vec<(u128, u64)>,
    capacity: usize,
}

impl Account {
    pub(super) fn new(max_clients: usize) -> Self {
        let body = StatusBody { pid: std::process::id(), ..StatusBody::default() };
        let last_pairs = Vec::with_capacity(max_clients);
        Self { start: Instant::now(), body, last_pairs, capacity: max_clients.max(1) }
    }

    pub(super) fn note_frame(
        &mut self,
        session: u128,
        fields: &ReplyFields,
        form: ObjectForm,
        pair_count: u64,
    ) {
        self.body.frames += 1;
        let objects = match form {
            ObjectForm::Boxes(_) => &mut self.body.boxes,
            ObjectForm::Spheres => &mut self.body.spheres,
        };
        *objects += u64::from(fields.box_count.get());
        self.body.pairs = self.body.pairs.saturating_add(pair_count);
        let mut known = self.last_pairs.iter_mut();
        if let Some((_, pairs)) = known.find(|(noted, _)| *noted == session) {
            *pairs = pair_count;
            return;
        }
        if self.last_pairs.len() >= self.capacity {
            // Clients that are gone fill the list; those that live are noted again.
            self.last_pairs.clear();
        }
        self.last_pairs.push((session, pair_count));
    }

    /// Pairs in a session's last frame, where it had one.
    pub(super) fn last_pairs(&self, session: u128) -> Option<u64> {
        self.last_pairs.iter().find(|(noted, _)| *noted == session).map(|(_, pairs)| *pairs)
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

    pub(super) fn body(&self, client_count: usize, audit: AuditCounts) -> StatusBody {
        StatusBody {
            client_count: u32::try_from(client_count).unwrap_or(u32::MAX),
            uptime_ns: self.start.elapsed().as_nanos() as u64,
            audit,
            ..self.body
        }
    }
}
