//! The sessions of a recording, as sessions of a daemon or of this process.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use pairmask::ConnectError;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::pacing::Expected;
use pairmask_core::{Aabb, BoxCount, BoxForm, EngineChoice, ObjectForm};
use pairmask_transport::{
    ConnectFailure, Exchange, Link, LinkError, LinkOptions, RuntimeDir, quiet_transport_log,
};
use pairmask_wire::{
    InstanceName, LONGEST_TICK, Operation, PAGE_BYTES, Reject, ReplyError, ReplyFields, Request,
    RequestHeader, Section, SectionKind, page_count,
};

use super::local::LocalSession;
use crate::precision::PrecisionChoice;
use crate::recording::{Answered, Entry, pages_of};
use crate::serve::DEFAULT_SPIN;

/// A request without an answer for so long ends the replay: all pairs of a million boxes on one thread.
const DEADLINE: Duration = Duration::from_secs(600);

/// Ticks of shared scenes are open for so many times as long as in the recording: on a machine under load, none is to end
/// by its deadline that did not then. One that did ends so much later.
const TICK_FACTOR: u64 = 4;

const LONGEST_TICK_NS: u64 = LONGEST_TICK.as_nanos() as u64;

#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    #[error("connecting to the daemon: {0}")]
    Connect(String),
    #[error("request {number}: {source}")]
    Request { number: u64, source: LinkError },
    #[error("request {number}: the recording holds none that is valid: {source}")]
    Invalid { number: u64, source: Reject },
    #[error("request {number}: {source}")]
    Reply { number: u64, source: ReplyError },
    #[error("request {number}: {source}")]
    Session { number: u64, source: ConnectError },
}

/// An answer to a request that was replayed.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Of the request.
    pub number: u64,
    pub answered: Answered,
    /// All that it names, sorted, where that is kept.
    pub entries: Option<Vec<Entry>>,
    pub round_trip: Duration,
    /// Whether it is a frame whose boxes were sent in another precision than recorded: it may have more pairs.
    pub may_have_more: bool,
}

/// Plays sessions of a recording. Each request is answered before the next one is sent, but for those that
/// are answered when others have been sent: edits of a shared scene.
pub struct Player {
    place: Place,
    /// In place of the engines that the requests name.
    engine: Option<EngineChoice>,
    /// That of frames which were sent as f32 boxes.
    precision: PrecisionChoice,
    keeps_entries: bool,
    sessions: HashMap<u64, Session>,
}

/// Who answers.
enum Place {
    Daemon { dir: RuntimeDir, instance: InstanceName },
    Process(AvailableIsa),
}

enum Session {
    Remote { link: Arc<Link>, waiting: Option<Box<Sent>> },
    Local(Box<LocalSession>),
}

struct Sent {
    number: u64,
    request: Request,
    asked: ReplyFields,
    may_have_more: bool,
    exchange: Exchange,
}

/// A request as it is played.
struct Played<'a> {
    number: u64,
    header: RequestHeader,
    payload: Cow<'a, [u8]>,
    may_have_more: bool,
}

impl Player {
    /// On the daemon that serves an instance.
    pub fn new(dir: RuntimeDir, instance: InstanceName) -> Self {
        quiet_transport_log();
        Self::at(Place::Daemon { dir, instance })
    }

    /// By the engines of this process. Requests of shared scenes have no answer then.
    pub fn in_process(isa: AvailableIsa) -> Self {
        Self::at(Place::Process(isa))
    }

    fn at(place: Place) -> Self {
        let (engine, precision, sessions) = (None, PrecisionChoice::Exact, HashMap::new());
        Self { place, engine, precision, keeps_entries: false, sessions }
    }

    /// With an engine for all frames and scenes.
    #[must_use]
    pub fn with_engine(self, engine: Option<EngineChoice>) -> Self {
        Self { engine, ..self }
    }

    /// With a precision for all frames that were sent as f32 boxes. Scenes have no precision.
    #[must_use]
    pub fn with_precision(self, precision: PrecisionChoice) -> Self {
        Self { precision, ..self }
    }

    /// With all that answers name, for comparison.
    #[must_use]
    pub fn keeping_entries(self) -> Self {
        Self { keeps_entries: true, ..self }
    }

    /// Sends a request of a session. Answers that have come by then are passed on: its own, and that of the request which
    /// the session waited for.
    pub fn send(
        &mut self,
        (session, number, header, payload): (u64, u64, &RequestHeader, &[u8]),
        mut each: impl FnMut(Answer),
    ) -> Result<(), PlayError> {
        self.receive(session, &mut each)?;
        let played = self.played(number, header, payload);
        if !self.sessions.contains_key(&session) {
            let begun = self.connect()?;
            self.sessions.insert(session, begun);
        }
        let keeps_entries = self.keeps_entries;
        let is_tick = match self.sessions.get_mut(&session) {
            Some(Session::Local(local)) => return answer_here(local, &played, keeps_entries, each),
            Some(Session::Remote { link, waiting }) => {
                let sent = send_to(link, &played)?;
                let is_tick = matches!(sent.request, Request::CommitShared(_));
                *waiting = Some(Box::new(sent));
                is_tick
            }
            None => true,
        };
        if is_tick { Ok(()) } else { self.receive(session, each) }
    }

    /// The request with what is asked for otherwise than recorded.
    fn played<'a>(&self, number: u64, header: &RequestHeader, payload: &'a [u8]) -> Played<'a> {
        let mut header = *header;
        if let Some(engine) = self.engine.filter(|_| names_engine(&header)) {
            header.engine = match engine {
                EngineChoice::Auto => 0,
                EngineChoice::Only(name) => name as u32,
            };
        }
        if header.operation == Operation::JoinShared as u32 {
            header.base = header.base.saturating_mul(TICK_FACTOR).min(LONGEST_TICK_NS);
        }
        let narrow = narrowed(&header, payload, self.precision);
        let may_have_more = narrow.is_some();
        let (header, payload) =
            narrow.map_or((header, payload.into()), |(header, payload)| (header, payload.into()));
        Played { number, header, payload, may_have_more }
    }

    /// Passes on the answer to a request, if a session waits for it.
    pub fn receive_number(
        &mut self,
        number: u64,
        each: impl FnMut(Answer),
    ) -> Result<(), PlayError> {
        let waits = |session: &Session| session.waiting().is_some_and(|sent| sent.number == number);
        let found = self.sessions.iter().find(|(_, session)| waits(session));
        found.map(|(session, _)| *session).map_or(Ok(()), |session| self.receive(session, each))
    }

    /// Ends a session.
    pub fn end(&mut self, session: u64, each: impl FnMut(Answer)) -> Result<(), PlayError> {
        self.receive(session, each)?;
        self.sessions.remove(&session);
        Ok(())
    }

    /// Ends all sessions.
    pub fn end_all(&mut self, mut each: impl FnMut(Answer)) -> Result<(), PlayError> {
        let sessions: Vec<u64> = self.sessions.keys().copied().collect();
        sessions.into_iter().try_for_each(|session| self.receive(session, &mut each))?;
        self.sessions.clear();
        Ok(())
    }

    fn connect(&self) -> Result<Session, PlayError> {
        let (dir, instance) = match &self.place {
            Place::Process(isa) => return Ok(Session::Local(Box::new(LocalSession::new(*isa)))),
            Place::Daemon { dir, instance } => (dir, instance),
        };
        let options = LinkOptions { dir, instance, capacity: None, leaves_silent: false };
        let link = Arc::new(Link::open(&options).map_err(|failure| why(&failure))?);
        Ok(Session::Remote { link, waiting: None })
    }

    /// Passes on the answer that a session waits for, if it does.
    fn receive(&mut self, session: u64, mut each: impl FnMut(Answer)) -> Result<(), PlayError> {
        let waiting = match self.sessions.get_mut(&session) {
            Some(Session::Remote { waiting, .. }) => waiting.take(),
            _ => None,
        };
        let Some(sent) = waiting else { return Ok(()) };
        let Sent { number, request, asked, may_have_more, exchange } = *sent;
        let answer = exchange.end(Expected::default(), DEFAULT_SPIN, DEADLINE);
        let answer = answer.map_err(|source| PlayError::Request { number, source })?;
        let mut kept = Kept::new(self.keeps_entries);
        let memory = (&answer.header, answer.memory.pages());
        let answered = Answered::of(&request, &asked, memory, |entry| kept.push(entry))
            .map_err(|source| PlayError::Reply { number, source })?;
        let (entries, round_trip) = (kept.sorted(), answer.round_trip);
        each(Answer { number, answered, entries, round_trip, may_have_more });
        Ok(())
    }
}

impl Session {
    fn waiting(&self) -> Option<&Sent> {
        match self {
            Self::Remote { waiting, .. } => waiting.as_deref(),
            Self::Local(_) => None,
        }
    }
}

/// The entries of an answer, where they are kept.
struct Kept(Option<Vec<Entry>>);

impl Kept {
    fn new(keeps: bool) -> Self {
        Self(keeps.then(Vec::new))
    }

    fn push(&mut self, entry: Entry) {
        if let Some(entries) = &mut self.0 {
            entries.push(entry);
        }
    }

    fn sorted(mut self) -> Option<Vec<Entry>> {
        if let Some(entries) = &mut self.0 {
            entries.sort_unstable();
        }
        self.0
    }
}

fn parsed(played: &Played<'_>) -> Result<Request, PlayError> {
    let payload_bytes = page_count(played.payload.len() as u64) * PAGE_BYTES as u64;
    Request::parse(&played.header, payload_bytes)
        .map_err(|source| PlayError::Invalid { number: played.number, source })
}

fn send_to(link: &Arc<Link>, played: &Played<'_>) -> Result<Sent, PlayError> {
    let Played { number, payload, may_have_more, .. } = played;
    let failed = |source| PlayError::Request { number: *number, source };
    let header = RequestHeader { client_token: link.token(), ..played.header };
    let request = parsed(played)?;
    let asked = ReplyFields {
        client_token: header.client_token,
        frame: header.frame,
        box_count: BoxCount::new(header.box_count),
    };
    let mut shared = link.loan(payload.len() as u64).map_err(failed)?;
    let pages: &mut [u8] = bytemuck::cast_slice_mut(shared.loan.pages_mut());
    pages[..payload.len()].copy_from_slice(payload);
    let exchange = Exchange::begin(shared, &header).map_err(|e| failed(e.into_error()))?;
    Ok(Sent { number: *number, request, asked, may_have_more: *may_have_more, exchange })
}

fn answer_here(
    session: &mut LocalSession,
    played: &Played<'_>,
    keeps_entries: bool,
    mut each: impl FnMut(Answer),
) -> Result<(), PlayError> {
    let Played { number, may_have_more, .. } = *played;
    let (request, pages) = (parsed(played)?, pages_of(&played.payload));
    let mut kept = Kept::new(keeps_entries);
    let answered = session.answer(&request, &pages, |entry| kept.push(entry));
    let answered = answered.map_err(|source| PlayError::Session { number, source })?;
    if let Some((answered, round_trip)) = answered {
        let entries = kept.sorted();
        each(Answer { number, answered, entries, round_trip, may_have_more });
    }
    Ok(())
}

/// A frame of f32 boxes with the boxes in another precision, whose bounds are those of the boxes. `None` where it is
/// none, or is to be exact.
fn narrowed(
    header: &RequestHeader,
    payload: &[u8],
    choice: PrecisionChoice,
) -> Option<(RequestHeader, Vec<u8>)> {
    let is_frame =
        [Operation::Cull, Operation::CullBetween].map(|o| o as u32).contains(&header.operation);
    if choice == PrecisionChoice::Exact || !is_frame {
        return None;
    }
    let kind = SectionKind::of(ObjectForm::Boxes(BoxForm::F32)) as u32;
    let at = header.sections.iter().position(|section| section.kind == kind)?;
    let start = usize::try_from(header.sections[at].offset).ok()?;
    let recorded = payload.get(start..)?.get(..header.sections[at].bytes as usize)?;
    let mut boxes: Vec<Aabb> = bytemuck::pod_collect_to_vec(recorded);
    choice.inflate(&mut boxes);
    let precision = choice.precision(&boxes);
    // No form has more bytes, so that what lies behind the boxes stays in its place.
    let bytes = boxes.len() * precision.form().box_bytes();
    let mut aligned: Vec<u64> = vec![0; bytes.div_ceil(size_of::<u64>())];
    let written = &mut bytemuck::cast_slice_mut::<u64, u8>(&mut aligned)[..bytes];
    precision.write(&boxes, written);
    let mut payload = payload.to_vec();
    payload[start..start + bytes].copy_from_slice(written);
    let mut header = *header;
    let kind = SectionKind::of(ObjectForm::Boxes(precision.form()));
    header.sections[at] = Section::required(kind, start as u64, bytes as u64);
    Some((header, payload))
}

fn why(failure: &ConnectFailure) -> PlayError {
    PlayError::Connect(match failure {
        ConnectFailure::NoDaemon => "none serves this instance".to_owned(),
        ConnectFailure::OtherUser { uid } => format!("the instance is that of user {uid}"),
        ConnectFailure::OtherVersion(version) => {
            format!("it speaks version {}.{} of the wire contract", version.major, version.minor)
        }
        ConnectFailure::Instance(error) => error.to_string(),
        ConnectFailure::Open(error) => error.to_string(),
    })
}

/// Whether a request says which engine answers: frames, and what a scene begins with.
fn names_engine(header: &RequestHeader) -> bool {
    let is = |operation: Operation| header.operation == operation as u32;
    is(Operation::Cull)
        || is(Operation::CullBetween)
        || is(Operation::JoinShared)
        || is(Operation::EditScene) && header.base == 0
}
