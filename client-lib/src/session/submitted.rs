//! A frame that was submitted.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::engine::CullError;
use pairmask_core::filters::Rules;
use pairmask_core::mask::MaskView;
use pairmask_core::objects::Objects;
use pairmask_core::pacing::Answered as AnsweredFrame;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    CullRequest, Page, Reply, ReplyError, ReplyFields, RequestHeader, ResponseHeader, RulesLayout,
    RulesNumber, RulesReader, RulesSections, StatusCode, page_count, words_in, world_ranges_in,
};

use super::core::{Core, say_refused};
use super::error::{Error, Loss};
use super::link::{CheckedResponse, Exchange, SharedFrame, loss_of};
use super::pairs::{PairMask, ServedBy, Storage};
use super::pending::{Answered, Request};
use super::written::Written;

impl Answered for PairMask {
    type Request = Submitted;
}

/// A frame that was submitted.
#[allow(clippy::large_enum_variant)] // A box would be an allocation in every frame.
pub enum Submitted {
    /// The daemon works on it.
    Sent(Sent),
    /// This process has answered it.
    Ready(PairMask),
}

impl std::fmt::Debug for Submitted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Sent(sent) => write!(f, "frame {} under way", sent.asked.frame),
            Self::Ready(_) => f.write_str("answered"),
        }
    }
}

/// A frame that the daemon works on. Its boxes stay readable, so that this process can cull them if
/// the daemon dies.
pub struct Sent {
    exchange: Exchange,
    asked: ReplyFields,
    written: Written,
    rules: SentRules,
    core: Arc<Core>,
}

/// The rules of a frame as they were sent.
enum SentRules {
    /// It has none.
    None,
    /// They lie behind its objects, with the number under which they are kept.
    Written(RulesSections, u64),
    /// The daemon keeps them under a number.
    Kept(Arc<Rules>, u64),
}

/// A frame that has no room for more, and why.
type Ungrown = (Error, SharedFrame);

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
    let number = match link.cached_rules().number_of(given, n) {
        RulesNumber::Known(number) => {
            return Ok((shared, SentRules::Kept(Arc::clone(given), number)));
        }
        RulesNumber::New(number) => number,
    };
    let written = write_rules(shared, n, written, given, core);
    if written.is_err() {
        // The daemon gets none of that number.
        link.cached_rules().discard();
    }
    written.map(|(shared, position)| (shared, SentRules::Written(position, number)))
}

/// Writes rules behind the objects of a frame.
#[allow(clippy::result_large_err)] // As above.
fn write_rules(
    shared: SharedFrame,
    n: BoxCount,
    written: Written,
    rules: &Rules,
    core: &Core,
) -> Result<(SharedFrame, RulesSections), Ungrown> {
    let used = written.scene(n).payload_bytes();
    let layout = match RulesLayout::of(rules, n, used) {
        Ok(layout) => layout,
        Err(error) => return Err((error.into(), shared)),
    };
    core.note_rules(&layout);
    let mut shared = shared
        .enlarged(layout.payload_bytes(), used)
        .map_err(|(error, frame)| (error.into(), frame))?;
    if layout.write(rules, shared.loan.pages_mut()) {
        Ok((shared, layout.sections()))
    } else {
        Err((Error::NoMemory { n: n.get() }, shared))
    }
}

impl Submitted {
    /// Sends a frame, or answers it here where the backend allows that and it cannot be sent.
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
            Err((error, shared)) if core.may_cull_here() => {
                core.say_in_process(&error);
                let mask = cull_shared(&core, shared.loan.pages(), n, written, rules)?;
                return Ok(Self::Ready(mask));
            }
            Err((error, _)) => return Err(error),
        };
        let asked =
            ReplyFields { client_token: link.token(), frame: core.next_frame(), box_count: n };
        let (position, rules_number) = match &sent_rules {
            SentRules::None => (None, 0),
            SentRules::Written(position, number) => (Some(*position), *number),
            SentRules::Kept(_, number) => (None, *number),
        };
        let settings = core.settings();
        let request = CullRequest {
            engine: settings.engine,
            encoding: settings.encoding,
            threads: settings.threads,
            iterate_threads: settings.iterate_threads,
            may_repeat: settings.answer_repeats,
            rules: position,
            rules_number,
            first_set: written.first_set,
            ..CullRequest::of(written.scene(n))
        };
        let header = RequestHeader::cull(asked.client_token, asked.frame, &request);
        let unsent = match Exchange::begin(shared, &header) {
            Ok(exchange) => {
                let rules = sent_rules;
                return Ok(Self::Sent(Sent { exchange, asked, written, rules, core }));
            }
            Err(unsent) => unsent,
        };
        let lost = core.lose(&link, loss_of(&unsent));
        lost?;
        let mask = cull_shared(&core, unsent.pages(), n, written, rules)?;
        Ok(Self::Ready(mask))
    }
}

impl Request<PairMask> for Submitted {
    fn deadline(&self) -> Duration {
        match self {
            Self::Sent(sent) => sent.core.settings().deadline,
            Self::Ready(_) => Duration::ZERO,
        }
    }

    fn has_come(&mut self, until: Instant) -> bool {
        let Self::Sent(Sent { exchange, asked, core, .. }) = self else { return true };
        let expected = exchange.link().expect(asked.box_count.get());
        exchange.has_come(expected, core.settings().spin, until)
    }

    fn take(self) -> Result<Result<PairMask, Self>, Error> {
        match self {
            Self::Ready(mask) => Ok(Ok(mask)),
            Self::Sent(sent) => sent.take(),
        }
    }

    fn answer_here(self) -> Result<PairMask, Error> {
        match self {
            Self::Ready(mask) => Ok(mask),
            Self::Sent(sent) if sent.core.may_cull_here() => {
                let _ = sent.core.lose(sent.exchange.link(), Loss::Silent);
                sent.cull_here()
            }
            Self::Sent(sent) => Err(Error::Timeout { waited: sent.core.settings().deadline }),
        }
    }
}

impl Sent {
    /// The pairs, by the answer that has come; the frame where it was sent again.
    fn take(mut self) -> Result<Result<PairMask, Submitted>, Error> {
        match self.exchange.take().map_err(Error::from) {
            Ok((header, response, round_trip)) => self.accept(&header, response, round_trip),
            Err(Error::Reply(refused)) => self.answer_refused(refused).map(Ok),
            Err(error) => {
                // The daemon has exited, or stands still.
                let how = Loss::of(&error).unwrap_or(Loss::Died);
                let _ = self.core.lose(self.exchange.link(), how);
                if self.core.may_cull_here() { self.cull_here().map(Ok) } else { Err(error) }
            }
        }
    }

    fn accept(
        self,
        header: &ResponseHeader,
        response: CheckedResponse,
        round_trip: Duration,
    ) -> Result<Result<PairMask, Submitted>, Error> {
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
                self.exchange.link().note_frame(AnsweredFrame {
                    n: self.asked.box_count.get(),
                    round_trip,
                    took: Duration::from_nanos(reply.times.total_ns),
                    threads: reply.threads,
                });
                let storage = Storage::Shared(self.exchange.hold(response));
                let isa = self.core.settings().isa;
                let mask = PairMask::new(storage, &reply, ServedBy::Daemon, self.written, isa);
                Ok(Ok(mask.with_worlds(worlds)))
            }
            // The daemon is asked once more, with the rules.
            Err(error) if self.lacks_rules(&error) => self.send_again(error.into()).map(Err),
            Err(error) => self.answer_refused(error).map(Ok),
        }
    }

    /// Whether the daemon does not keep the rules that the frame named.
    fn lacks_rules(&self, error: &ReplyError) -> bool {
        matches!(error, ReplyError::Status { status: StatusCode::UnknownRules, .. })
            && matches!(self.rules, SentRules::Kept(..))
    }

    /// Sends the frame once more, with its rules and in its own place: other frames may hold all others. Where there is
    /// no memory for that, the frame is answered in process, if the backend allows that, or with the error.
    fn send_again(self, error: Error) -> Result<Submitted, Error> {
        let Self { exchange, asked, written, rules, core } = self;
        let SentRules::Kept(kept, _) = &rules else { return Err(error) };
        exchange.link().cached_rules().discard();
        let n = asked.box_count;
        let bytes = written.scene(n).payload_bytes();
        let pages = page_count(bytes) as usize;
        // The request ends here: beside it the transport has no room for another one where the session has all of its
        // places.
        let boxes = exchange.pages().get(..pages).unwrap_or_default().to_vec();
        let again = SharedFrame::lend(exchange.into_slot(), bytes);
        let again = again.map_err(Error::from).and_then(|mut shared| {
            if let Some(to) = shared.loan.pages_mut().get_mut(..boxes.len()) {
                to.copy_from_slice(&boxes);
            }
            Submitted::send(shared, n, written, Some(kept), Arc::clone(&core))
        });
        match again {
            Err(_) if core.may_cull_here() => {
                Ok(Submitted::Ready(cull_shared(&core, &boxes, n, written, Some(kept))?))
            }
            again => again.map_err(|_| error),
        }
    }

    /// The daemon's response is an error or malformed: answers in process where the backend allows
    /// that.
    fn answer_refused(&self, refused: ReplyError) -> Result<PairMask, Error> {
        if !self.core.may_cull_here() {
            return Err(refused.into());
        }
        say_refused(self.exchange.link(), &refused);
        match self.cull_here() {
            // Only the daemon has the engine: its own error is the cause to report.
            Err(Error::Cull(CullError::Unavailable { .. })) => Err(refused.into()),
            answer => answer,
        }
    }

    fn cull_here(&self) -> Result<PairMask, Error> {
        let (pages, n) = (self.exchange.pages(), self.asked.box_count);
        let mut reader = RulesReader::default();
        let rules = match &self.rules {
            SentRules::None => None,
            SentRules::Kept(rules, _) => Some(&**rules),
            // This process wrote them: only another one can have made them wrong.
            SentRules::Written(position, _) => {
                Some(reader.read(position, n, pages).map_err(|_| changed_rules())?.rules())
            }
        };
        Ok(cull_shared(&self.core, pages, n, self.written, rules)?)
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
    core.local().cull(objects.unwrap_or(Objects::Spheres(&[])), rules, written)
}
