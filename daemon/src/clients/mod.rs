//! What the daemon keeps of its clients, by session.
//!
//! A session is who the transport's registers say that a request comes from; its token is an echo.
//! Nothing here is needed for a right answer: what was forgotten is found again, estimated, or sent again.

mod known;
mod scenes;
mod work;

pub(crate) use self::scenes::{KeptScene, NoRoom, PendingBoxes, SceneMemory, SceneRoom};
pub use self::work::GpuNeed;
pub(crate) use self::work::{FrameWork, RequestKind};

use std::sync::{Mutex, MutexGuard, PoisonError};

use pairmask_transport::{Sender, WakeClient};
use pairmask_wire::SceneId;

use self::known::{Known, find_listener};
use self::work::LastWork;
use crate::execute::Executor;

/// The clients, and the port that wakes them.
pub(crate) struct Clients {
    notifier: WakeClient,
    known: Mutex<Known>,
}

impl Clients {
    /// Of an instance that at most `max_clients` connect to.
    pub(crate) fn new(notifier: WakeClient, max_clients: usize) -> Self {
        Self { notifier, known: Mutex::new(Known::new(max_clients)) }
    }

    /// Pairs in a session's last frame, for the plan of its next; `None` where it had none.
    pub(crate) fn last_pairs(&self, session: u128) -> Option<u64> {
        self.known().find(session)?.last_pairs
    }

    /// Notes the pairs of a session's frame.
    pub(crate) fn note_pairs(&self, session: u128, pair_count: u64) {
        self.known().of(session).last_pairs = Some(pair_count);
    }

    /// Notes what a session's request took.
    pub(crate) fn note_work(&self, session: u128, kind: RequestKind, work: FrameWork) {
        self.known().of(session).last_work.note(kind, work);
    }

    /// What is expected of a session's request with so many objects.
    pub(crate) fn expected_work(
        &self,
        session: u128,
        kind: RequestKind,
        objects: u32,
    ) -> FrameWork {
        let known = self.known();
        let expected = known.find(session).map(|client| client.last_work.expected(kind, objects));
        expected.unwrap_or_else(|| LastWork::default().expected(kind, objects))
    }

    /// Takes a session's engines, which no other thread has meanwhile. `None` where it has none yet.
    pub(crate) fn take_engines(&self, session: u128) -> Option<Box<Executor>> {
        self.known().of(session).engines.take()
    }

    /// Keeps a session's engines for its next frame.
    pub(crate) fn keep_engines(&self, session: u128, engines: Box<Executor>) {
        self.known().of(session).engines = Some(engines);
    }

    /// Takes a session's scene, which no other thread has meanwhile. `None` where it has no such scene.
    pub(crate) fn take_scene(&self, session: u128, id: SceneId) -> Option<KeptScene> {
        let mut known = self.known();
        let scenes = &mut known.of(session).scenes;
        let place = scenes.iter().position(|kept| kept.id() == id)?;
        Some(scenes.swap_remove(place))
    }

    /// Keeps a session's scene for its next edit.
    pub(crate) fn keep_scene(&self, session: u128, scene: KeptScene) {
        self.known().of(session).scenes.push(scene);
    }

    /// Wakes the client that sent a request with this token, and no other: by the listener of its
    /// session that bears the token. About 50 ns while it does not sleep.
    pub(crate) fn wake(&self, sender: Sender, client_token: u64) {
        let known = self.known().of(sender.session).listener;
        let wakes = |listener| self.notifier.notify_single_listener(&listener).is_ok();
        if known.is_some_and(wakes) {
            return;
        }
        let found = find_listener(&self.notifier, sender.session, client_token);
        // A client that went away between these lines needs no waking.
        let _ = found.is_some_and(wakes);
        self.known().of(sender.session).listener = found;
    }

    /// Forgets sessions that are gone, and has engines give up scratch that has not been used for long;
    /// to be called now and then.
    pub(crate) fn tidy(&self, sessions: impl FnOnce() -> Vec<u128>) {
        let candidates = self.known().sessions();
        // After the candidates: a session that comes meanwhile is none of them.
        let sessions = sessions();
        let is_gone = |session: u128| candidates.contains(&session) && !sessions.contains(&session);
        let mut known = self.known();
        let gone = known.remove_gone(is_gone);
        known.iter_mut().filter_map(|client| client.engines.as_mut()).for_each(|e| e.tidy());
        drop(known);
        // Large scenes take a while to free.
        drop(gone);
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
