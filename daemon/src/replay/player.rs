//! The sessions of a recording, as sessions of a daemon.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use pairmask_core::pacing::Expected;
use pairmask_core::{BoxCount, EngineChoice};
use pairmask_transport::{
    ConnectFailure, Exchange, Link, LinkError, LinkOptions, RuntimeDir, quiet_transport_log,
};
use pairmask_wire::{
    InstanceName, LONGEST_TICK, Operation, PAGE_BYTES, Reject, ReplyError, ReplyFields, Request,
    RequestHeader, page_count,
};

use crate::recording::{Answered, Entry};
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
}

/// Plays sessions of a recording on a daemon. Each request is answered before the next one is sent, but for those that
/// are answered when others have been sent: edits of a shared scene.
pub struct Player {
    dir: RuntimeDir,
    instance: InstanceName,
    /// In place of the engines that the requests name.
    engine: Option<EngineChoice>,
    keeps_entries: bool,
    sessions: HashMap<u64, Session>,
}

struct Session {
    link: Arc<Link>,
    waiting: Option<Sent>,
}

struct Sent {
    number: u64,
    request: Request,
    asked: ReplyFields,
    exchange: Exchange,
}

impl Player {
    /// On the daemon that serves an instance.
    pub fn new(dir: RuntimeDir, instance: InstanceName) -> Self {
        quiet_transport_log();
        Self { dir, instance, engine: None, keeps_entries: false, sessions: HashMap::new() }
    }

    /// With an engine for all frames and scenes.
    #[must_use]
    pub fn with_engine(self, engine: Option<EngineChoice>) -> Self {
        Self { engine, ..self }
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
        let failed = |source| PlayError::Request { number, source };
        let link = match self.sessions.get(&session) {
            Some(session) => Arc::clone(&session.link),
            None => self.connect(session)?,
        };
        let payload_bytes = page_count(payload.len() as u64) * PAGE_BYTES as u64;
        let mut header = RequestHeader { client_token: link.token(), ..*header };
        if let Some(engine) = self.engine.filter(|_| names_engine(&header)) {
            header.engine = match engine {
                EngineChoice::Auto => 0,
                EngineChoice::Only(name) => name as u32,
            };
        }
        if header.operation == Operation::JoinShared as u32 {
            header.base = header.base.saturating_mul(TICK_FACTOR).min(LONGEST_TICK_NS);
        }
        let request = Request::parse(&header, payload_bytes)
            .map_err(|source| PlayError::Invalid { number, source })?;
        let asked = ReplyFields {
            client_token: header.client_token,
            frame: header.frame,
            box_count: BoxCount::new(header.box_count),
        };
        let mut shared = link.loan(payload.len() as u64).map_err(failed)?;
        let pages: &mut [u8] = bytemuck::cast_slice_mut(shared.loan.pages_mut());
        pages[..payload.len()].copy_from_slice(payload);
        let exchange = Exchange::begin(shared, &header).map_err(|e| failed(e.into_error()))?;
        let is_tick = matches!(request, Request::CommitShared(_));
        if let Some(session) = self.sessions.get_mut(&session) {
            session.waiting = Some(Sent { number, request, asked, exchange });
        }
        if is_tick { Ok(()) } else { self.receive(session, each) }
    }

    /// Passes on the answer to a request, if a session waits for it.
    pub fn receive_number(
        &mut self,
        number: u64,
        each: impl FnMut(Answer),
    ) -> Result<(), PlayError> {
        let waits =
            |session: &Session| session.waiting.as_ref().is_some_and(|s| s.number == number);
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

    fn connect(&mut self, session: u64) -> Result<Arc<Link>, PlayError> {
        let options = LinkOptions {
            dir: &self.dir,
            instance: &self.instance,
            capacity: None,
            leaves_silent: false,
        };
        let link = Arc::new(Link::open(&options).map_err(|failure| why(&failure))?);
        self.sessions.insert(session, Session { link: Arc::clone(&link), waiting: None });
        Ok(link)
    }

    /// Passes on the answer that a session waits for, if it does.
    fn receive(&mut self, session: u64, mut each: impl FnMut(Answer)) -> Result<(), PlayError> {
        let Some(sent) = self.sessions.get_mut(&session).and_then(|s| s.waiting.take()) else {
            return Ok(());
        };
        let Sent { number, request, asked, exchange } = sent;
        let answer = exchange.end(Expected::default(), DEFAULT_SPIN, DEADLINE);
        let answer = answer.map_err(|source| PlayError::Request { number, source })?;
        let mut entries = self.keeps_entries.then(Vec::new);
        let keep = |entry| {
            if let Some(entries) = &mut entries {
                entries.push(entry);
            }
        };
        let answered =
            Answered::of(&request, &asked, (&answer.header, answer.memory.pages()), keep)
                .map_err(|source| PlayError::Reply { number, source })?;
        if let Some(entries) = &mut entries {
            entries.sort_unstable();
        }
        each(Answer { number, answered, entries, round_trip: answer.round_trip });
        Ok(())
    }
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
