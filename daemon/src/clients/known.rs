//! The clients that are remembered.

use iceoryx2::port::notifier::ListenerKey;
use iceoryx2::prelude::CallbackProgression;
use pairmask_transport::{WakeClient, listener_name};

use super::scenes::KeptScene;
use super::work::LastWork;
use crate::execute::Executor;

/// Clients by session, as many as may connect. They are few: each look is a walk along the list.
pub(super) struct Known {
    clients: Vec<Client>,
    capacity: usize,
    /// Looks so far.
    looks: u64,
    /// What was kept of clients that others took the place of: large scenes take a while to free.
    forgotten: Vec<Client>,
}

impl Known {
    /// Room for so many clients, and one at the least.
    pub(super) fn new(max_clients: usize) -> Self {
        let capacity = max_clients.max(1);
        Self { clients: Vec::with_capacity(capacity), capacity, looks: 0, forgotten: Vec::new() }
    }

    /// A client that is remembered.
    pub(super) fn find(&self, session: u128) -> Option<&Client> {
        self.clients.iter().find(|client| client.session() == session)
    }

    /// The clients that are remembered.
    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Client> {
        self.clients.iter_mut()
    }

    /// Their sessions.
    pub(super) fn sessions(&self) -> Vec<u128> {
        self.clients.iter().map(Client::session).collect()
    }

    /// Forgets clients that are gone, and returns what was kept of them and of others that were forgotten.
    pub(super) fn remove_gone(&mut self, is_gone: impl Fn(u128) -> bool) -> Vec<Client> {
        let mut gone = std::mem::take(&mut self.forgotten);
        gone.extend(self.clients.extract_if(.., |client| is_gone(client.session())));
        gone
    }

    /// A client, remembered from now on. Where clients that are gone fill the list, the one is forgotten that was
    /// looked for longest ago, of those without scenes if there are any: others would have to send theirs again.
    pub(super) fn of(&mut self, session: u128) -> &mut Client {
        self.looks += 1;
        let found = self.clients.iter().position(|client| client.session() == session);
        let place = found.unwrap_or_else(|| {
            if self.clients.len() >= self.capacity {
                let all = self.clients.iter().enumerate();
                let least =
                    all.min_by_key(|(_, client)| (!client.scenes.is_empty(), client.looked_at));
                let place = least.map_or(0, |(place, _)| place);
                self.forgotten.push(self.clients.swap_remove(place));
            }
            self.clients.push(Client::new(session));
            self.clients.len() - 1
        });
        let client = &mut self.clients[place];
        client.looked_at = self.looks;
        client
    }
}

/// What is kept of a client. Everything that belongs to one session and outlives a request goes here.
pub(super) struct Client {
    session: u128,
    /// The number of the last look for it.
    pub(super) looked_at: u64,
    /// What wakes it, once it was found.
    pub(super) listener: Option<ListenerKey>,
    /// Pairs in its last frame, once it had one.
    pub(super) last_pairs: Option<u64>,
    /// What its last requests took.
    pub(super) last_work: LastWork,
    /// Its engines, while no frame of it is being culled.
    pub(super) engines: Option<Box<Executor>>,
    /// Its scenes, but for one that is being changed.
    pub(super) scenes: Vec<KeptScene>,
}

impl Client {
    /// A client of which nothing is known yet.
    pub(super) fn new(session: u128) -> Self {
        Self {
            session,
            looked_at: 0,
            listener: None,
            last_pairs: None,
            last_work: LastWork::default(),
            engines: None,
            scenes: Vec::new(),
        }
    }

    /// Its session, by the transport's number of the node.
    pub(super) const fn session(&self) -> u128 {
        self.session
    }
}

/// The listener of a session that bears the name of this token.
pub(super) fn find_listener(
    notifier: &WakeClient,
    session: u128,
    client_token: u64,
) -> Option<ListenerKey> {
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
    fn clients_are_remembered_one_by_one() {
        let mut known = Known::new(3);
        for session in [1, 2, 1] {
            let client = known.of(session);
            client.last_pairs = Some(client.last_pairs.unwrap_or(0) + session as u64);
        }
        let pairs = |known: &Known, session| known.find(session).and_then(|c| c.last_pairs);
        assert_eq!([1, 2, 3].map(|session| pairs(&known, session)), [Some(2), Some(2), None]);
    }

    #[test]
    fn a_full_list_forgets_and_never_grows() {
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
