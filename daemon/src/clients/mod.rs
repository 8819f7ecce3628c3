//! What the daemon keeps of its clients, by session.
//!
//! A session is a client's connection; its token is an echo.
//! Nothing here is needed for a right answer: what was dropped is found again, estimated, or sent again.

mod engines;
mod heap;
mod scenes;
mod work;

pub(crate) use self::engines::SessionEngines;
pub(crate) use self::scenes::{PendingBoxes, SceneRoom, SceneTotals, SessionScene};
pub use self::work::GpuNeed;
pub(crate) use self::work::{FrameWork, RequestKind};

use std::sync::Mutex;

use pairmask_wire::SceneId;

use self::work::LastWork;
use crate::locked;

pub(crate) struct Clients {
    known: Mutex<Known>,
}

impl Clients {
    pub(crate) fn new(max_clients: usize) -> Self {
        Self { known: Mutex::new(Known::new(max_clients)) }
    }

    /// Pairs in a session's last frame, for the plan of its next; `None` where it had none.
    pub(crate) fn last_pairs(&self, session: u64) -> Option<u64> {
        locked(&self.known).find(session)?.last_pairs
    }

    /// Changes what is kept of a session, which is remembered from now on.
    pub(crate) fn of<R>(&self, session: u64, change: impl FnOnce(&mut Client) -> R) -> R {
        change(locked(&self.known).of(session))
    }

    pub(crate) fn expected_work(&self, session: u64, kind: RequestKind, objects: u32) -> FrameWork {
        let known = locked(&self.known);
        let expected = known.find(session).map(|client| client.last_work.expected(kind, objects));
        expected.unwrap_or_else(|| LastWork::default().expected(kind, objects))
    }

    /// Takes a session's scene, which no other thread has meanwhile. `None` where it has no such scene.
    pub(crate) fn take_scene(&self, session: u64, id: SceneId) -> Option<SessionScene> {
        let mut known = locked(&self.known);
        let scenes = &mut known.of(session).scenes;
        let slot = scenes.iter().position(|kept| kept.id == id)?;
        Some(scenes.swap_remove(slot))
    }

    /// Drops ended sessions, and tidies engines; to be called now and then.
    pub(crate) fn tidy(&self, sessions: impl FnOnce() -> Vec<u64>) {
        let candidates: Vec<u64> =
            locked(&self.known).clients.iter().map(|client| client.session).collect();
        // After the candidates: a session that comes meanwhile is none of them.
        let sessions = sessions();
        let has_ended =
            |session: u64| candidates.contains(&session) && !sessions.contains(&session);
        let mut known = locked(&self.known);
        // Beside those whose place others took.
        let mut ended = std::mem::take(&mut known.discarded);
        ended.extend(known.clients.extract_if(.., |client| has_ended(client.session)));
        let engines = known.clients.iter_mut().filter_map(|client| client.engines.as_mut());
        engines.for_each(|engines| engines.tidy());
        drop(known);
        // Large scenes take a while to free.
        if !ended.is_empty() {
            drop(ended);
            heap::give_back();
        }
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

    fn find(&self, session: u64) -> Option<&Client> {
        self.clients.iter().find(|client| client.session == session)
    }

    /// A client, remembered from now on. Where disconnected clients fill the list, the one is dropped that was
    /// looked for longest ago, of those without scenes if there are any: others would have to send theirs again.
    fn of(&mut self, session: u64) -> &mut Client {
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
    session: u64,
    looked_at: u64,
    pub(crate) last_pairs: Option<u64>,
    pub(crate) last_work: LastWork,
    /// Its engines, while no frame of it is being culled.
    pub(crate) engines: Option<Box<SessionEngines>>,
    /// Its scenes, but for one that is being changed.
    pub(crate) scenes: Vec<SessionScene>,
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
                known.of(stays).last_pairs.get_or_insert(stays);
            }
            known.of(session).last_pairs = Some(0);
        }
        let pairs = [1, 2, 3].map(|session| known.find(session).and_then(|c| c.last_pairs));
        assert_eq!(pairs, [Some(1), Some(2), Some(3)]);
    }
}
