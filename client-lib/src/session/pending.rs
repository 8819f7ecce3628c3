//! A frame under way.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::engine::CullError;
use pairmask_core::mask::MaskView;
use pairmask_core::objects::Objects;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    CullRequest, Page, Reply, ReplyError, ReplyFields, RequestHeader, ResponseHeader, StatusCode,
    words_in,
};

use super::core::{Core, Loss};
use super::error::{FrameError, WaitError};
use super::estimate::Answered;
use super::frame::Written;
use super::link::{Received, SharedFrame, Slot, Unsent};
use super::pairs::{PairMask, ServedBy, Storage};
use crate::transport::{CheckedResponse, SentRequest};

/// A frame that was submitted. Dropping it discards the answer.
pub struct PendingFrame {
    state: State,
    core: Arc<Core>,
}

impl std::fmt::Debug for PendingFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let state = match &self.state {
            State::Sent(sent) => format!("frame {} under way", sent.asked.frame),
            State::Ready(_) => "answered".to_owned(),
            State::Taken => "taken".to_owned(),
        };
        f.debug_tuple("PendingFrame").field(&state).finish()
    }
}

#[allow(clippy::large_enum_variant)] // A box would be an allocation in every frame.
enum State {
    Sent(Sent),
    Ready(PairMask),
    Taken,
}

/// A frame that the daemon works on. Its boxes stay readable, so that this process can cull them if
/// the daemon dies.
pub(super) struct Sent {
    pending: SentRequest,
    asked: ReplyFields,
    written: Written,
    at: Instant,
    slot: Slot,
}

impl PendingFrame {
    pub(super) fn ready(mask: PairMask, core: Arc<Core>) -> Self {
        Self { state: State::Ready(mask), core }
    }

    pub(super) fn send(
        shared: SharedFrame,
        n: BoxCount,
        written: Written,
        core: Arc<Core>,
    ) -> Result<Self, FrameError> {
        let link = Arc::clone(shared.slot.link());
        let settings = core.settings();
        if written.first_set.is_some() && !link.forms().knows(written.since_minor()) {
            let what = "frames of two sets";
            if !core.may_cull_here() {
                return Err(FrameError::DaemonTooOld { what });
            }
            link.forms().say_stay(written.since_minor(), what);
            let mask = cull_shared(&core, shared.loan.pages(), n, written)?;
            return Ok(Self::ready(mask, core));
        }
        let asked =
            ReplyFields { client_token: link.token(), frame: core.next_frame(), box_count: n };
        let request = CullRequest {
            engine: settings.engine,
            encoding: link.encodings().agree(settings.encoding),
            threads: settings.threads,
            visit_threads: settings.visit_threads,
            may_repeat: settings.answer_repeats,
            first_set: written.first_set,
            ..CullRequest::of(written.scene(n))
        };
        let header = RequestHeader::cull(asked.client_token, asked.frame, &request);
        let at = Instant::now();
        match shared.send(&header) {
            Ok((pending, slot)) if pending.is_delivered() => {
                Ok(Self { state: State::Sent(Sent { pending, asked, written, at, slot }), core })
            }
            Ok((pending, _slot)) => {
                let how = if link.is_alive() { Loss::Silent } else { Loss::Died };
                core.lose(&link, how)?;
                let mask = cull_shared(&core, pending.pages(), n, written)?;
                Ok(Self::ready(mask, core))
            }
            Err(Unsent::Saved(shared)) => {
                core.lose(&link, Loss::Died)?;
                let mask = cull_shared(&core, shared.loan.pages(), n, written)?;
                Ok(Self::ready(mask, core))
            }
            Err(Unsent::Lost(error)) => {
                // The failed call dropped the memory: an error even for `Backend::Auto`.
                let _ = core.lose(&link, Loss::Died);
                Err(error.into())
            }
        }
    }

    /// Waits for the pairs, as long as the session's deadline allows.
    ///
    /// # Errors
    /// [`WaitError`]. With [`Backend::Auto`](super::Backend::Auto), no failure of the daemon is an
    /// error: the frame is then answered in process.
    pub fn wait(mut self) -> Result<PairMask, WaitError> {
        let deadline = self.core.settings().deadline;
        match self.wait_timeout(deadline) {
            Err(WaitError::Timeout { waited }) => match &self.state {
                State::Sent(sent) if self.core.may_cull_here() => {
                    let _ = self.core.lose(sent.slot.link(), Loss::Silent);
                    sent.cull_here(&self.core)
                }
                _ => Err(WaitError::Timeout { waited }),
            },
            other => other,
        }
    }

    /// The pairs if the answer has come.
    ///
    /// # Errors
    /// [`WaitError`], [`WaitError::Taken`] where the pairs were taken before.
    pub fn try_take(&mut self) -> Result<Option<PairMask>, WaitError> {
        match self.wait_timeout(Duration::ZERO) {
            Err(WaitError::Timeout { .. }) => Ok(None),
            other => other.map(Some),
        }
    }

    /// Waits for the pairs, at most `timeout`.
    ///
    /// # Errors
    /// [`WaitError::Timeout`] when `timeout` passed: the frame is still under way. Else
    /// [`WaitError`].
    pub fn wait_timeout(&mut self, timeout: Duration) -> Result<PairMask, WaitError> {
        let result = match std::mem::replace(&mut self.state, State::Taken) {
            State::Ready(mask) => return Ok(mask),
            State::Taken => return Err(WaitError::Taken),
            State::Sent(sent) => sent.wait(&self.core, timeout),
        };
        match result {
            Ok(mask) => Ok(mask),
            Err((error, sent)) => {
                if let Some(sent) = sent {
                    self.state = State::Sent(sent);
                }
                Err(error)
            }
        }
    }
}

impl Sent {
    #[allow(clippy::result_large_err)] // The error holds the frame, which its caller puts back.
    fn wait(
        mut self,
        core: &Core,
        timeout: Duration,
    ) -> Result<PairMask, (WaitError, Option<Self>)> {
        let deadline = Instant::now() + timeout;
        let spin = core.settings().spin;
        let n = self.asked.box_count.get();
        let link = self.slot.link();
        match link.receive(&mut self.pending, self.at, link.expect(n), spin, deadline) {
            Ok(Received::Sample(sample)) => {
                let answered_after = self.at.elapsed();
                match self.slot.link().check(sample) {
                    Some((header, response)) => {
                        self.accept(&header, response, answered_after, core)
                    }
                    None => self
                        .answer_refused(ReplyError::Malformed { field: "place" }, core)
                        .map_err(|e| (e, None)),
                }
            }
            Ok(Received::Nothing) => Err((WaitError::Timeout { waited: timeout }, Some(self))),
            Ok(Received::Dead) => self.stand_in(core, WaitError::DaemonDied),
            Err(error) => self.stand_in(core, error.into()),
        }
    }

    #[allow(clippy::result_large_err)]
    fn accept(
        self,
        header: &ResponseHeader,
        response: CheckedResponse,
        answered_after: Duration,
        core: &Core,
    ) -> Result<PairMask, (WaitError, Option<Self>)> {
        let words = words_in(response.pages());
        let payload_bytes = size_of_val(words) as u64;
        let checked = Reply::parse(header, &self.asked, payload_bytes).and_then(|reply| {
            MaskView::new(self.asked.box_count, &reply.report.shape, words)
                .map_err(|_| ReplyError::Malformed { field: "mask" })?;
            Ok(reply)
        });
        match checked {
            Ok(reply) => {
                let Self { pending, slot, .. } = self;
                slot.link().note_frame(Answered {
                    n: self.asked.box_count.get(),
                    round_trip: answered_after,
                    took: Duration::from_nanos(reply.times.total_ns),
                    threads: reply.threads,
                });
                let storage = Storage::Shared { response, _pending: pending, _slot: slot };
                let isa = core.settings().isa;
                Ok(PairMask::new(storage, &reply, ServedBy::Daemon, self.written, isa))
            }
            Err(error) => self.answer_refused(error, core).map_err(|e| (e, None)),
        }
    }

    /// The daemon's response is an error or malformed: answers in process where the backend allows
    /// that.
    fn answer_refused(&self, refused: ReplyError, core: &Core) -> Result<PairMask, WaitError> {
        let is_bad_request =
            matches!(refused, ReplyError::Status { status: StatusCode::BadRequest, .. });
        if is_bad_request {
            // The next frame is not sent in a form that the daemon may not know.
            self.slot.link().forms().note_refused(self.written);
        }
        if !core.may_cull_here() {
            return Err(refused.into());
        }
        if !is_bad_request || self.written.since_minor() == 0 {
            self.slot.link().say_refused(&refused);
        }
        match self.cull_here(core) {
            // Only the daemon has the engine: its own error is the cause to report.
            Err(WaitError::Cull(CullError::Unavailable { .. })) => Err(refused.into()),
            answer => answer,
        }
    }

    /// The daemon is gone: answers in process, or returns the error.
    #[allow(clippy::result_large_err)]
    fn stand_in(
        self,
        core: &Core,
        error: WaitError,
    ) -> Result<PairMask, (WaitError, Option<Self>)> {
        let allowed = core.may_cull_here();
        let _ = core.lose(self.slot.link(), Loss::Died);
        if allowed { self.cull_here(core).map_err(|e| (e, None)) } else { Err((error, None)) }
    }

    fn cull_here(&self, core: &Core) -> Result<PairMask, WaitError> {
        Ok(cull_shared(core, self.pending.pages(), self.asked.box_count, self.written)?)
    }
}

/// Finds the pairs of the objects in a request's memory with the engines of this process.
fn cull_shared(
    core: &Core,
    pages: &[Page],
    n: BoxCount,
    written: Written,
) -> Result<PairMask, CullError> {
    let objects = written.scene(n).objects_in(pages);
    // The memory was lent for exactly these objects, so that `objects` is never `None`.
    core.cull_here(objects.unwrap_or(Objects::Spheres(&[])), written)
}
