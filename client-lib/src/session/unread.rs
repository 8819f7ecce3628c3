//! Edits and ends of scenes that the daemon works on, and those of them whose answers nobody waits for.
//!
//! Each holds one of the session's places until its answer is received. The answer to an edit that was
//! dropped is received when its scene is edited again, or before, when something else of the session needs
//! a place and none is free. An edit is never dropped before that: the daemon passes over requests that are
//! dropped.

use std::sync::{Arc, Mutex, MutexGuard, TryLockError, Weak};
use std::time::{Duration, Instant};

use pairmask_core::pacing::Expected;
use pairmask_core::scene::Report;
use pairmask_core::units::BoxCount;
use pairmask_wire::{ReplyFields, RequestHeader, SceneReply};

use super::error::{Error, Loss};
use super::link::{Answer, Exchange, Link, SharedFrame};
use super::settings::Settings;
use super::spares::lock;

/// An edit, or a scene's end, that the daemon works on.
pub(super) struct SentEdit {
    pub exchange: Exchange,
    pub asked: ReplyFields,
    pub report: Report,
    pub expected: Expected,
}

impl SentEdit {
    /// Waits for the answer, as long as the deadline allows.
    pub fn receive(mut self, settings: &Settings) -> Result<(Answer, SceneReply), Error> {
        let waited = settings.deadline;
        if self.exchange.has_come(self.expected, settings.spin, Instant::now() + waited) {
            self.received()
        } else {
            Err(Error::Timeout { waited })
        }
    }

    /// The answer that has come.
    fn received(self) -> Result<(Answer, SceneReply), Error> {
        let answer = self.exchange.received()?;
        let payload_bytes = size_of_val(answer.memory.pages()) as u64;
        let reply = SceneReply::parse(&answer.header, &self.asked, payload_bytes)?;
        Ok((answer, reply))
    }

    fn is_on(&self, link: &Arc<Link>) -> bool {
        Arc::ptr_eq(self.exchange.link(), link)
    }
}

/// An edit whose caller may wait for its answer. Dropped, it is left to the session.
#[derive(Default)]
pub(super) struct Awaited(Option<(SentEdit, Arc<Unread>)>);

impl Awaited {
    pub const fn new(sent: SentEdit, unread: Arc<Unread>) -> Self {
        Self(Some((sent, unread)))
    }

    /// Waits until then for the answer. Whether it has come, or is here.
    pub fn has_come(&mut self, spin: Duration, until: Instant) -> bool {
        let Some((sent, _)) = &mut self.0 else { return true };
        sent.exchange.has_come(sent.expected, spin, until)
    }

    /// The edit, which the caller waits for; `None` where this process has answered it.
    pub fn take(mut self) -> Option<SentEdit> {
        self.0.take().map(|(sent, _)| sent)
    }
}

impl Drop for Awaited {
    fn drop(&mut self) {
        if let Some((sent, unread)) = self.0.take() {
            *lock(&unread.0) = State::Sent(sent);
        }
    }
}

/// What became of an edit that nobody waits for.
pub(super) type Outcome = Result<SceneReply, Error>;

/// The last edit of a scene, where nobody waits for its answer.
///
/// The lock is held while a thread receives that answer, as long as the deadline allows: a thread that needs the
/// lock then needs the answer, or its place.
#[derive(Default)]
pub(super) struct Unread(Mutex<State>);

#[allow(clippy::large_enum_variant)] // One of each scene.
#[derive(Default)]
enum State {
    #[default]
    Nothing,
    Sent(SentEdit),
    /// The place is free again. The scene will ask.
    Received(Outcome),
}

impl Unread {
    /// What became of the edit, if there is one: waits for its answer as long as the deadline allows.
    pub fn settle(&self, settings: &Settings) -> Option<Outcome> {
        match std::mem::take(&mut *lock(&self.0)) {
            State::Nothing => None,
            State::Sent(sent) => Some(sent.receive(settings).map(|(_, reply)| reply)),
            State::Received(outcome) => Some(outcome),
        }
    }

    /// Receives the answer if it comes to this connection until then. Returns whether that freed a place. An answer
    /// that another thread waits for is left to it.
    fn receive_until(&self, link: &Arc<Link>, until: Instant) -> bool {
        let Some(mut state) = self.try_lock() else { return false };
        match std::mem::take(&mut *state) {
            State::Sent(mut sent) if sent.is_on(link) => {
                let has_come = sent.exchange.has_come_by(until);
                *state = if has_come {
                    State::Received(sent.received().map(|(_, reply)| reply))
                } else {
                    State::Sent(sent)
                };
                has_come
            }
            other => {
                *state = other;
                false
            }
        }
    }

    /// Whether it holds a place of this connection, as far as one knows who does not wait.
    fn may_hold_slot(&self, link: &Arc<Link>) -> bool {
        let Some(state) = self.try_lock() else { return true };
        matches!(&*state, State::Sent(sent) if sent.is_on(link))
    }

    fn try_lock(&self) -> Option<MutexGuard<'_, State>> {
        match self.0.try_lock() {
            Ok(state) => Some(state),
            Err(TryLockError::Poisoned(error)) => Some(error.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// The frame number of an edit whose place on this connection is not free.
    fn frame_on(&self, link: &Arc<Link>) -> Option<u64> {
        match &*lock(&self.0) {
            State::Sent(sent) if sent.is_on(link) => Some(sent.asked.frame),
            _ => None,
        }
    }

    /// Waits for the answer to the edit of this number, if that still holds its place.
    fn receive(&self, frame: u64, settings: &Settings) -> Result<(), Loss> {
        let mut state = lock(&self.0);
        match std::mem::take(&mut *state) {
            State::Sent(sent) if sent.asked.frame == frame => {
                let outcome = sent.receive(settings).map(|(_, reply)| reply);
                let loss = outcome.as_ref().err().and_then(Loss::of);
                *state = State::Received(outcome);
                loss.map_or(Ok(()), Err)
            }
            other => {
                *state = other;
                Ok(())
            }
        }
    }
}

/// A scene that has ended in this process.
pub(super) struct Ending {
    link: Weak<Link>,
    header: RequestHeader,
}

impl Ending {
    /// Of a scene that the daemon knows by this connection.
    pub fn new(link: &Arc<Link>, header: &RequestHeader) -> Self {
        Self { link: Arc::downgrade(link), header: *header }
    }

    fn is_on(&self, link: &Arc<Link>) -> bool {
        std::ptr::eq(self.link.as_ptr(), Arc::as_ptr(link))
    }
}

/// What ended scenes leave to their session.
#[derive(Default)]
struct Ended {
    /// What has yet to be reported to the daemon.
    unreported: Vec<Ending>,
    /// Their last edits, and ends that were reported to the daemon.
    sent: Vec<Arc<Unread>>,
}

/// The unread edits of a session's scenes.
#[derive(Default)]
pub(super) struct UnreadEdits {
    scenes: Mutex<Vec<Weak<Unread>>>,
    ended: Mutex<Ended>,
}

impl std::fmt::Debug for UnreadEdits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("UnreadEdits")
    }
}

impl UnreadEdits {
    /// A new scene's.
    pub fn of_new_scene(&self) -> Arc<Unread> {
        let unread = Arc::default();
        let mut all = lock(&self.scenes);
        all.retain(|scene| scene.strong_count() > 0);
        all.push(Arc::downgrade(&unread));
        unread
    }

    /// Keeps what a scene leaves behind that has ended: the daemon is informed when there is a place for that.
    pub fn end(&self, ending: Ending, last_edit: &Arc<Unread>) {
        let mut ended = lock(&self.ended);
        ended.unreported.push(ending);
        ended.sent.push(Arc::clone(last_edit));
    }

    /// Informs the daemon of ended scenes, in places that `slot` gives, and waits for no answer.
    ///
    /// # Errors
    /// Why there is no place. What is left to report is reported by the next call.
    pub fn report_ended<E>(
        &self,
        link: &Arc<Link>,
        mut slot: impl FnMut() -> Result<SharedFrame, E>,
    ) -> Result<(), E> {
        while let Some(ending) = self.next_unreported(link) {
            let shared = match slot() {
                Ok(shared) => shared,
                Err(error) => {
                    lock(&self.ended).unreported.push(ending);
                    return Err(error);
                }
            };
            // An end that is not sent needs none: the daemon has exited, or drops a session that it lost.
            if let Ok(exchange) = Exchange::begin(shared, &ending.header) {
                let Ending { header, .. } = ending;
                let asked = ReplyFields {
                    client_token: header.client_token,
                    frame: header.frame,
                    box_count: BoxCount::default(),
                };
                let expected = link.expect(0);
                let sent = SentEdit { exchange, asked, report: Report::Nothing, expected };
                lock(&self.ended).sent.push(Arc::new(Unread(Mutex::new(State::Sent(sent)))));
            }
        }
        Ok(())
    }

    /// Waits until then for the daemon to have done what ended scenes left to it.
    pub fn wait_for_ended(&self, link: &Arc<Link>, deadline: Instant) {
        let sent = lock(&self.ended).sent.clone();
        for one in sent {
            one.receive_until(link, deadline);
        }
    }

    /// An ended scene that the daemon has yet to be informed of. Gives up what is answered, and what belongs to
    /// another connection: a scene ends with it.
    fn next_unreported(&self, link: &Arc<Link>) -> Option<Ending> {
        let mut ended = lock(&self.ended);
        ended
            .sent
            .retain(|sent| !sent.receive_until(link, Instant::now()) && sent.may_hold_slot(link));
        ended.unreported.retain(|ending| ending.is_on(link));
        ended.unreported.pop()
    }

    /// Receives an answer that has come. Returns whether that freed a place of this connection.
    pub fn receive_landed(&self, link: &Arc<Link>) -> bool {
        self.all().iter().any(|unread| unread.receive_until(link, Instant::now()))
    }

    /// Receives an answer of this connection, after a wait as long as the deadline allows. Returns whether
    /// there was one to wait for.
    ///
    /// # Errors
    /// How the daemon was lost that did not answer.
    pub fn receive_oldest(&self, link: &Arc<Link>, settings: &Settings) -> Result<bool, Loss> {
        let all = self.all();
        // The daemon serves a session's requests one after the other.
        let numbered = all.iter().filter_map(|unread| Some((unread.frame_on(link)?, unread)));
        match numbered.min_by_key(|(frame, _)| *frame) {
            Some((frame, unread)) => unread.receive(frame, settings).map(|()| true),
            None => Ok(false),
        }
    }

    /// Those of scenes, and of ended ones. No lock of theirs is waited for while these lists' are held.
    fn all(&self) -> Vec<Arc<Unread>> {
        let mut all: Vec<_> = lock(&self.scenes).iter().filter_map(Weak::upgrade).collect();
        all.extend(lock(&self.ended).sent.iter().cloned());
        all
    }
}
