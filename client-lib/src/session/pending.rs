//! A frame under way.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::engine::CullError;
use pairmask_core::filters::Rules;
use pairmask_core::mask::MaskView;
use pairmask_core::objects::Objects;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    CullRequest, Page, Reply, ReplyError, ReplyFields, RequestHeader, ResponseHeader, RulesLayout,
    RulesPlace, RulesReader, StatusCode, page_count, words_in, world_ranges_in,
};

use super::core::Core;
use super::error::{Error, Loss};
use super::estimate::Answered;
use super::exchange::Exchange;
use super::kept_rules::RulesNumber;
use super::link::{SharedFrame, Ungrown};
use super::pairs::{PairMask, ServedBy};
use super::settings::LONGEST_WAIT;
use super::written::Written;
use crate::transport::CheckedResponse;

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
    exchange: Exchange,
    asked: ReplyFields,
    written: Written,
    rules: SentRules,
}

/// The rules of a frame as they were sent.
enum SentRules {
    /// It has none.
    None,
    /// They lie behind its objects, with the number under which they are kept.
    Written(RulesPlace, u64),
    /// The daemon keeps them under a number.
    Kept(Arc<Rules>, u64),
}

/// Readies a frame with rules: those that the daemon does not keep are written behind its objects.
#[allow(clippy::result_large_err)] // The error holds the frame, which its caller goes on with.
fn with_rules(
    shared: SharedFrame,
    n: BoxCount,
    written: Written,
    given: &Arc<Rules>,
    core: &Core,
) -> Result<(SharedFrame, SentRules), Ungrown> {
    let link = Arc::clone(shared.slot.link());
    let number = match link.kept_rules().number_of(given, n) {
        RulesNumber::Known(number) => {
            return Ok((shared, SentRules::Kept(Arc::clone(given), number)));
        }
        RulesNumber::New(number) => number,
    };
    let written = write_rules(shared, n, written, given, core);
    if written.is_err() {
        // The daemon gets none of that number.
        link.kept_rules().forget();
    }
    written.map(|(shared, place)| (shared, SentRules::Written(place, number)))
}

/// Writes rules behind the objects of a frame.
#[allow(clippy::result_large_err)] // As above.
fn write_rules(
    shared: SharedFrame,
    n: BoxCount,
    written: Written,
    rules: &Rules,
    core: &Core,
) -> Result<(SharedFrame, RulesPlace), Ungrown> {
    let used = written.scene(n).payload_bytes();
    let layout = match RulesLayout::of(rules, n, used) {
        Ok(layout) => layout,
        Err(error) => return Err(Ungrown { frame: Some(shared), error: error.into() }),
    };
    core.note_rules(&layout);
    let mut shared = shared.grown(layout.payload_bytes(), used)?;
    if layout.write(rules, shared.loan.pages_mut()) {
        Ok((shared, layout.place()))
    } else {
        Err(Ungrown { frame: Some(shared), error: Error::NoMemory { n: n.get() } })
    }
}

impl PendingFrame {
    pub(super) fn ready(mask: PairMask, core: Arc<Core>) -> Self {
        Self { state: State::Ready(mask), core }
    }

    pub(super) fn send(
        shared: SharedFrame,
        n: BoxCount,
        written: Written,
        given: Option<&Arc<Rules>>,
        core: Arc<Core>,
    ) -> Result<Self, Error> {
        let rules = given.map(|given| &**given);
        let link = Arc::clone(shared.slot.link());
        let ready = match given {
            Some(given) => with_rules(shared, n, written, given, &core),
            None => Ok((shared, SentRules::None)),
        };
        let (shared, sent_rules) = match ready {
            Ok(ready) => ready,
            Err(Ungrown { frame: Some(shared), error }) if core.may_cull_here() => {
                core.say_in_process(&error);
                let mask = cull_shared(&core, shared.loan.pages(), n, written, rules)?;
                return Ok(Self::ready(mask, core));
            }
            Err(Ungrown { error, .. }) => return Err(error),
        };
        let asked =
            ReplyFields { client_token: link.token(), frame: core.next_frame(), box_count: n };
        let (place, rules_number) = match &sent_rules {
            SentRules::None => (None, 0),
            SentRules::Written(place, number) => (Some(*place), *number),
            SentRules::Kept(_, number) => (None, *number),
        };
        let settings = core.settings();
        let request = CullRequest {
            engine: settings.engine,
            encoding: settings.encoding,
            threads: settings.threads,
            visit_threads: settings.visit_threads,
            may_repeat: settings.answer_repeats,
            rules: place,
            rules_number,
            first_set: written.first_set,
            ..CullRequest::of(written.scene(n))
        };
        let header = RequestHeader::cull(asked.client_token, asked.frame, &request);
        let unsent = match Exchange::begin(shared, &header) {
            Ok(exchange) => {
                let sent = Sent { exchange, asked, written, rules: sent_rules };
                return Ok(Self { state: State::Sent(sent), core });
            }
            Err(unsent) => unsent,
        };
        let lost = core.lose(&link, unsent.loss());
        let Some(pages) = unsent.pages() else {
            // The failed call dropped the memory: an error even for `Backend::Auto`.
            return Err(unsent.into());
        };
        lost?;
        let mask = cull_shared(&core, pages, n, written, rules)?;
        Ok(Self::ready(mask, core))
    }

    /// Waits for the pairs, as long as the session's deadline allows.
    ///
    /// # Errors
    /// [`Error`]. With [`Backend::Auto`](super::Backend::Auto), no failure of the daemon is an
    /// error: the frame is then answered in process.
    pub fn wait(mut self) -> Result<PairMask, Error> {
        let deadline = self.core.settings().deadline;
        match self.wait_timeout(deadline) {
            Err(Error::Timeout { waited }) => match &self.state {
                State::Sent(sent) if self.core.may_cull_here() => {
                    let _ = self.core.lose(sent.exchange.link(), Loss::Silent);
                    sent.cull_here(&self.core)
                }
                _ => Err(Error::Timeout { waited }),
            },
            other => other,
        }
    }

    /// The pairs if the answer has come.
    ///
    /// # Errors
    /// [`Error`], [`Error::Taken`] where the pairs were taken before.
    pub fn try_take(&mut self) -> Result<Option<PairMask>, Error> {
        match self.wait_timeout(Duration::ZERO) {
            Err(Error::Timeout { .. }) => Ok(None),
            other => other.map(Some),
        }
    }

    /// Waits for the pairs, at most `timeout`. More than a day is a day.
    ///
    /// # Errors
    /// [`Error::Timeout`] when `timeout` passed: the frame is still under way. Else
    /// [`Error`].
    pub fn wait_timeout(&mut self, timeout: Duration) -> Result<PairMask, Error> {
        let (started, timeout) = (Instant::now(), timeout.min(LONGEST_WAIT));
        let result = match std::mem::replace(&mut self.state, State::Taken) {
            State::Ready(mask) => return Ok(mask),
            State::Taken => return Err(Error::Taken),
            State::Sent(sent) => sent.wait(&self.core, timeout),
        };
        match result {
            Ok(mask) => Ok(mask),
            Err((Error::Reply(error), Some(sent))) => {
                let waited = started.elapsed();
                self.state = sent.send_again(error.into(), &self.core)?;
                self.wait_timeout(timeout.saturating_sub(waited))
            }
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
    /// Waits for the answer. The error holds the frame where it is still under way, or, after a
    /// [`Error::Reply`], where it is to be sent again.
    #[allow(clippy::result_large_err)] // The error holds the frame, which its caller puts back.
    fn wait(mut self, core: &Core, timeout: Duration) -> Result<PairMask, (Error, Option<Self>)> {
        let (deadline, spin) = (Instant::now() + timeout, core.settings().spin);
        let expected = self.exchange.link().expect(self.asked.box_count.get());
        match self.exchange.receive(expected, spin, deadline) {
            Ok(Some(sample)) => {
                let answered_after = self.exchange.at().elapsed();
                match self.exchange.check(sample) {
                    Ok((header, response)) => self.accept(&header, response, answered_after, core),
                    Err(error) => self.answer_refused(error, core).map_err(|e| (e, None)),
                }
            }
            Ok(None) => Err((Error::Timeout { waited: timeout }, Some(self))),
            Err(error) => {
                // The daemon is gone, or stands still.
                let how = Loss::of(&error).unwrap_or(Loss::Died);
                let _ = core.lose(self.exchange.link(), how);
                let answered = if core.may_cull_here() { self.cull_here(core) } else { Err(error) };
                answered.map_err(|error| (error, None))
            }
        }
    }

    #[allow(clippy::result_large_err)]
    fn accept(
        self,
        header: &ResponseHeader,
        response: CheckedResponse,
        answered_after: Duration,
        core: &Core,
    ) -> Result<PairMask, (Error, Option<Self>)> {
        let words = words_in(response.pages());
        let payload_bytes = size_of_val(words) as u64;
        let checked = Reply::parse(header, &self.asked, payload_bytes).and_then(|reply| {
            MaskView::new(self.asked.box_count, &reply.report.shape, words)
                .map_err(|_| ReplyError::Malformed { field: "mask" })?;
            let worlds = match self.rules {
                SentRules::None => Vec::new(),
                _ => world_ranges_in(header, &reply.report.shape, words)?,
            };
            Ok((reply, worlds))
        });
        match checked {
            Ok((reply, worlds)) => {
                self.exchange.link().note_frame(Answered {
                    n: self.asked.box_count.get(),
                    round_trip: answered_after,
                    took: Duration::from_nanos(reply.times.total_ns),
                    threads: reply.threads,
                });
                let storage = self.exchange.into_storage(response);
                let isa = core.settings().isa;
                let mask = PairMask::new(storage, &reply, ServedBy::Daemon, self.written, isa);
                Ok(mask.with_worlds(worlds))
            }
            // The daemon is asked once more, with the rules.
            Err(error) if self.lacks_rules(&error) => Err((error.into(), Some(self))),
            Err(error) => self.answer_refused(error, core).map_err(|e| (e, None)),
        }
    }

    /// Whether the daemon does not keep the rules that the frame named.
    fn lacks_rules(&self, error: &ReplyError) -> bool {
        matches!(error, ReplyError::Status { status: StatusCode::UnknownRules, .. })
            && matches!(self.rules, SentRules::Kept(..))
    }

    /// Sends the frame once more, with its rules and in its own place: other frames may hold all others. Where there is
    /// no memory for that, the frame is answered in process, if the backend allows that, or with the error.
    fn send_again(self, error: Error, core: &Arc<Core>) -> Result<State, Error> {
        let Self { exchange, asked, written, rules } = self;
        let SentRules::Kept(kept, _) = &rules else { return Err(error) };
        exchange.link().kept_rules().forget();
        let n = asked.box_count;
        let bytes = written.scene(n).payload_bytes();
        let pages = page_count(bytes) as usize;
        // The request ends here: beside it the transport has no room for another one where the session has all of its
        // places.
        let boxes = exchange.pages().get(..pages).unwrap_or_default().to_vec();
        let again = SharedFrame::lend(exchange.into_slot(), bytes).and_then(|mut shared| {
            if let Some(to) = shared.loan.pages_mut().get_mut(..boxes.len()) {
                to.copy_from_slice(&boxes);
            }
            PendingFrame::send(shared, n, written, Some(kept), Arc::clone(core))
        });
        match again {
            Ok(pending) => Ok(pending.state),
            Err(_) if core.may_cull_here() => {
                Ok(State::Ready(cull_shared(core, &boxes, n, written, Some(kept))?))
            }
            Err(_) => Err(error),
        }
    }

    /// The daemon's response is an error or malformed: answers in process where the backend allows
    /// that.
    fn answer_refused(&self, refused: ReplyError, core: &Core) -> Result<PairMask, Error> {
        if !core.may_cull_here() {
            return Err(refused.into());
        }
        self.exchange.link().say_refused(&refused);
        match self.cull_here(core) {
            // Only the daemon has the engine: its own error is the cause to report.
            Err(Error::Cull(CullError::Unavailable { .. })) => Err(refused.into()),
            answer => answer,
        }
    }

    fn cull_here(&self, core: &Core) -> Result<PairMask, Error> {
        let (pages, n) = (self.exchange.pages(), self.asked.box_count);
        let mut reader = RulesReader::default();
        let rules = match &self.rules {
            SentRules::None => None,
            SentRules::Kept(rules, _) => Some(&**rules),
            // This process wrote them: only another one can have made them wrong.
            SentRules::Written(place, _) => {
                Some(reader.read(place, n, pages).map_err(|_| changed_rules())?.rules())
            }
        };
        Ok(cull_shared(core, pages, n, self.written, rules)?)
    }
}

/// Another process has written to the memory of a frame.
const fn changed_rules() -> ReplyError {
    ReplyError::Malformed { field: "request's rules" }
}

/// Finds the pairs of the objects in a request's memory with the engines of this process.
fn cull_shared(
    core: &Core,
    pages: &[Page],
    n: BoxCount,
    written: Written,
    rules: Option<&Rules>,
) -> Result<PairMask, CullError> {
    let objects = written.scene(n).objects_in(pages);
    // The memory was lent for exactly these objects, so that `objects` is never `None`.
    core.cull_here(objects.unwrap_or(Objects::Spheres(&[])), rules, written)
}
