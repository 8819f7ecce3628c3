//! What the daemon keeps of its clients, by session.
//!
//! A session is who the transport's registers say that a request comes from; its token is an echo.
//! Nothing here is needed for a right answer: what was dropped is found again, estimated, or sent again.

mod scenes;
mod work;

pub(crate) use self::scenes::{NoRoom, PendingBoxes, SceneMemory, SceneRoom, SessionScene};
pub use self::work::GpuNeed;
pub(crate) use self::work::{FrameWork, RequestKind};

use std::sync::Mutex;

use iceoryx2::port::notifier::ListenerKey;
use iceoryx2::prelude::CallbackProgression;
use pairmask_transport::{Sender, WakeClient, listener_name};
use pairmask_wire::SceneId;

use self::work::LastWork;
use crate::execute::Executor;
use crate::locked;

pub(crate) struct Clients {
    notifier: WakeClient,
    known: Mutex<Known>,
}

impl Clients {
    pub(crate) fn new(notifier: WakeClient, max_clients: usize) -> Self {
        Self { notifier, known: Mutex::new(Known::new(max_clients)) }
    }

    /// Pairs in a session's last frame, for the plan of its next; `None` where it had none.
    pub(crate) fn last_pairs(&self, session: u128) -> Option<u64> {
        locked(&self.known).find(session)?.last_pairs
    }

    /// Changes what is kept of a session, which is remembered from now on.
    pub(crate) fn of<R>(&self, session: u128, change: impl FnOnce(&mut Client) -> R) -> R {
        change(locked(&self.known).of(session))
    }

    pub(crate) fn expected_work(
        &self,
        session: u128,
        kind: RequestKind,
        objects: u32,
    ) -> FrameWork {
        let known = locked(&self.known);
        let expected = known.find(session).map(|client| client.last_work.expected(kind, objects));
        expected.unwrap_or_else(|| LastWork::default().expected(kind, objects))
    }

    /// Takes a session's scene, which no other thread has meanwhile. `None` where it has no such scene.
    pub(crate) fn take_scene(&self, session: u128, id: SceneId) -> Option<SessionScene> {
        let mut known = locked(&self.known);
        let scenes = &mut known.of(session).scenes;
        let slot = scenes.iter().position(|kept| kept.id == id)?;
        Some(scenes.swap_remove(slot))
    }

    /// Wakes the client that sent a request with this token, and no other: by the listener of its
    /// session that bears the token. About 50 ns while it does not sleep.
    pub(crate) fn wake(&self, sender: Sender, client_token: u64) {
        let known = locked(&self.known).of(sender.session).listener;
        let wakes = |listener| self.notifier.notify_single_listener(&listener).is_ok();
        if known.is_some_and(wakes) {
            return;
        }
        let found = find_listener(&self.notifier, sender.session, client_token);
        // A client that went away between these lines needs no waking.
        let _ = found.is_some_and(wakes);
        locked(&self.known).of(sender.session).listener = found;
    }

    /// Drops ended sessions, and tidies engines; to be called now and then.
    pub(crate) fn tidy(&self, sessions: impl FnOnce() -> Vec<u128>) {
        let candidates: Vec<u128> =
            locked(&self.known).clients.iter().map(|client| client.session).collect();
        // After the candidates: a session that comes meanwhile is none of them.
        let sessions = sessions();
        let has_ended =
            |session: u128| candidates.contains(&session) && !sessions.contains(&session);
        let mut known = locked(&self.known);
        // Beside those whose place others took.
        let mut ended = std::mem::take(&mut known.discarded);
        ended.extend(known.clients.extract_if(.., |client| has_ended(client.session)));
        let engines = known.clients.iter_mut().filter_map(|client| client.engines.as_mut());
        engines.for_each(|engines| engines.tidy());
        drop(known);
        // Large scenes take a while to free.
        drop(ended);
    }
}

/// Clients by session, as many as may connect. They are few: each look is a walk along the list.
struct Known {
    clients: Vec<Client>,
    capacity: usize,
    looks: u64,
    /// What was kept of clients that others took the place of: large scenes take a while to free.
    discarded: Vec<Client>,
}

impl Known {
    fn new(max_clients: usize) -> Self {
        let capacity = max_clients.max(1);
        Self { clients: Vec::with_capacity(capacity), capacity, looks: 0, discarded: Vec::new() }
    }

    fn find(&self, session: u128) -> Option<&Client> {
        self.clients.iter().find(|client| client.session == session)
    }

    /// A client, remembered from now on. Where disconnected clients fill the list, the one is dropped that was
    /// looked for longest ago, of those without scenes if there are any: others would have to send theirs again.
    fn of(&mut self, session: u128) -> &mut Client {
        self.looks += 1;
        let found = self.clients.iter().position(|client| client.session == session);
        let slot = found.unwrap_or_else(|| {
            if self.clients.len() >= self.capacity {
                let all = self.clients.iter().enumerate();
                let least =
                    all.min_by_key(|(_, client)| (!client.scenes.is_empty(), client.looked_at));
                let slot = least.map_or(0, |(slot, _)| slot);
                self.discarded.push(self.clients.swap_remove(slot));
            }
            self.clients.push(Client { session, ..Client::default() });
            self.clients.len() - 1
        });
        let client = &mut self.clients[slot];
        client.looked_at = self.looks;
        client
    }
}

/// What is kept of a client. Everything that belongs to one session and outlives a request goes here.
#[derive(Default)]
pub(crate) struct Client {
    session: u128,
    looked_at: u64,
    listener: Option<ListenerKey>,
    pub(crate) last_pairs: Option<u64>,
    pub(crate) last_work: LastWork,
    /// Its engines, while no frame of it is being culled.
    pub(crate) engines: Option<Box<Executor>>,
    /// Its scenes, but for one that is being changed.
    pub(crate) scenes: Vec<SessionScene>,
}

fn find_listener(notifier: &WakeClient, session: u128, client_token: u64) -> Option<ListenerKey> {
    let name = listener_name(client_token)?;
    let mut found = None;
    notifier.for_each_listener(|listener, details| {
        if details.listener_name == name && details.node_id.value() == session {
            found = Some(listener.listener_key());
            return CallbackProgression::Stop;
        }
        CallbackProgression::Continue
    });
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_list_drops_and_never_grows() {
        for max_clients in [0, 1, 4] {
            let mut known = Known::new(max_clients);
            let room = known.clients.capacity();
            for session in 0..20 {
                known.of(session).last_pairs = Some(7);
                assert!(known.clients.len() <= max_clients.max(1));
                assert!(known.find(session).is_some_and(|client| client.last_pairs == Some(7)));
            }
            assert_eq!(known.clients.capacity(), room, "no allocation");
        }
    }

    #[test]
    fn sessions_that_come_and_go_leave_those_alone_that_stay() {
        let mut known = Known::new(4);
        for session in 100..200 {
            for stays in [1, 2, 3] {
                known.of(stays).last_pairs.get_or_insert(stays as u64);
            }
            known.of(session).last_pairs = Some(0);
        }
        let pairs = [1, 2, 3].map(|session| known.find(session).and_then(|c| c.last_pairs));
        assert_eq!(pairs, [Some(1), Some(2), Some(3)]);
    }
}
