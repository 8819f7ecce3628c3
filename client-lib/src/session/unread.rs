//! Edits of scenes that the daemon works on, and those of them whose answers nobody waits for.
//!
//! Each holds one of the session's places until its answer is received. The answer to an edit that was
//! dropped is received when its scene is edited again, or before, when something else of the session wants
//! a place and none is free. An edit is never dropped before that: the daemon passes over requests that are
//! dropped.

use std::marker::PhantomData;
use std::sync::{Arc, Mutex, TryLockError, Weak};

use pairmask_core::scene::Want;
use pairmask_wire::{ReplyFields, SceneReply};

use super::builder::Settings;
use super::core::Loss;
use super::error::WaitError;
use super::estimate::Expected;
use super::exchange::{Answer, Exchange};
use super::link::Link;
use super::local::lock;

/// An edit that the daemon works on.
pub(super) struct SentEdit {
    pub exchange: Exchange,
    pub asked: ReplyFields,
    pub want: Want,
    pub expected: Expected,
}

impl SentEdit {
    /// Waits for the answer, as long as the deadline allows.
    pub fn receive(self, settings: &Settings) -> Result<(Answer, SceneReply), WaitError> {
        let Self { exchange, asked, expected, .. } = self;
        parse(exchange.end(expected, settings)?, &asked)
    }

    /// What the answer tells, once it has come; its memory is given back. Else the edit.
    #[allow(clippy::result_large_err)] // Its caller puts it back.
    fn try_receive(self) -> Result<Outcome, Self> {
        let Self { exchange, asked, want, expected } = self;
        match exchange.try_end() {
            Ok(answer) => Ok(answer.and_then(|answer| Ok(parse(answer, &asked)?.1))),
            Err(exchange) => Err(Self { exchange, asked, want, expected }),
        }
    }
}

fn parse(answer: Answer, asked: &ReplyFields) -> Result<(Answer, SceneReply), WaitError> {
    let payload_bytes = size_of_val(answer.response.pages()) as u64;
    let reply = SceneReply::parse(&answer.header, asked, payload_bytes)?;
    Ok((answer, reply))
}

/// An edit while its scene is borrowed for the answer. Dropped, it is left to the session.
///
/// The lifetime is that of the borrowed scene: no other edit of it is begun before.
#[derive(Default)]
pub(super) struct Awaited<'s> {
    sent: Option<(SentEdit, Arc<Unread>)>,
    scene: PhantomData<&'s mut ()>,
}

impl Awaited<'_> {
    pub const fn new(sent: SentEdit, unread: Arc<Unread>) -> Self {
        Self { sent: Some((sent, unread)), scene: PhantomData }
    }

    /// The edit, which the caller waits for; `None` where this process has answered it.
    pub fn take(mut self) -> Option<SentEdit> {
        self.sent.take().map(|(sent, _)| sent)
    }
}

impl Drop for Awaited<'_> {
    fn drop(&mut self) {
        if let Some((sent, unread)) = self.sent.take() {
            unread.leave(sent);
        }
    }
}

/// What became of an edit that nobody waits for.
pub(super) type Outcome = Result<SceneReply, WaitError>;

/// The last edit of a scene, where nobody waits for its answer.
///
/// The lock is held while a thread receives that answer, as long as the deadline allows: whoever wants the
/// lock then wants the answer, or its place.
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
    /// Nobody waits for the answer to this edit.
    fn leave(&self, sent: SentEdit) {
        *lock(&self.0) = State::Sent(sent);
    }

    /// What became of the edit, if there is one: waits for its answer as long as the deadline allows.
    pub fn settle(&self, settings: &Settings) -> Option<Outcome> {
        let mut state = lock(&self.0);
        match std::mem::take(&mut *state) {
            State::Nothing => None,
            State::Sent(sent) => Some(sent.receive(settings).map(|(_, reply)| reply)),
            State::Received(outcome) => Some(outcome),
        }
    }

    /// Receives the answer if it has come to this connection. Returns whether that freed a place. An answer
    /// that another thread waits for is left to it.
    fn try_receive(&self, link: &Arc<Link>) -> bool {
        let mut state = match self.0.try_lock() {
            Ok(state) => state,
            Err(TryLockError::Poisoned(error)) => error.into_inner(),
            Err(TryLockError::WouldBlock) => return false,
        };
        match std::mem::take(&mut *state) {
            State::Sent(sent) if sent.exchange.is_on(link) => match sent.try_receive() {
                Ok(outcome) => {
                    *state = State::Received(outcome);
                    true
                }
                Err(sent) => {
                    *state = State::Sent(sent);
                    false
                }
            },
            other => {
                *state = other;
                false
            }
        }
    }

    /// The frame number of an edit whose place on this connection is not free.
    fn frame_on(&self, link: &Arc<Link>) -> Option<u64> {
        match &*lock(&self.0) {
            State::Sent(sent) if sent.exchange.is_on(link) => Some(sent.asked.frame),
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

/// The unread edits of a session's scenes.
#[derive(Default)]
pub(super) struct UnreadEdits(Mutex<Vec<Weak<Unread>>>);

impl std::fmt::Debug for UnreadEdits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("UnreadEdits")
    }
}

impl UnreadEdits {
    /// A new scene's.
    pub fn of_new_scene(&self) -> Arc<Unread> {
        let unread = Arc::default();
        let mut all = lock(&self.0);
        all.retain(|scene| scene.strong_count() > 0);
        all.push(Arc::downgrade(&unread));
        unread
    }

    /// Receives an answer that has come. Returns whether that freed a place of this connection.
    pub fn receive_landed(&self, link: &Arc<Link>) -> bool {
        self.of_scenes().iter().any(|unread| unread.try_receive(link))
    }

    /// Receives an answer of this connection, after a wait as long as the deadline allows. Returns whether
    /// there was one to wait for.
    ///
    /// # Errors
    /// How the daemon was lost that did not answer.
    pub fn receive_oldest(&self, link: &Arc<Link>, settings: &Settings) -> Result<bool, Loss> {
        let scenes = self.of_scenes();
        // The daemon serves a session's requests one after the other.
        let numbered = scenes.iter().filter_map(|unread| Some((unread.frame_on(link)?, unread)));
        match numbered.min_by_key(|(frame, _)| *frame) {
            Some((frame, unread)) => unread.receive(frame, settings).map(|()| true),
            None => Ok(false),
        }
    }

    /// No scene's lock is taken while this list's is held.
    fn of_scenes(&self) -> Vec<Arc<Unread>> {
        lock(&self.0).iter().filter_map(Weak::upgrade).collect()
    }
}
