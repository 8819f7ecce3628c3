//! Waking the client whose answer is there, and no other.

use iceoryx2::port::notifier::ListenerKey;
use iceoryx2::prelude::CallbackProgression;
use pairmask::transport::{Sender, WakeClient, listener_name};

/// Which listener belongs to which session.
pub(super) struct WakeBoard {
    notifier: WakeClient,
    known: Vec<(u128, ListenerKey)>,
    capacity: usize,
}

impl WakeBoard {
    pub(super) fn new(notifier: WakeClient, max_clients: usize) -> Self {
        Self { notifier, known: Vec::with_capacity(max_clients), capacity: max_clients }
    }

    /// Wakes a sender, by the listener of its session that bears its token. About 50 ns while it does
    /// not sleep.
    pub(super) fn wake(&mut self, sender: Sender, client_token: u64) {
        if let Some(at) = self.known.iter().position(|(session, _)| *session == sender.session) {
            if self.notifier.notify_single_listener(&self.known[at].1).is_ok() {
                return;
            }
            self.known.swap_remove(at);
        }
        if let Some(key) = self.find(sender, client_token) {
            if self.known.len() >= self.capacity {
                // Clients that are gone fill the board; those that live are found again.
                self.known.clear();
            }
            self.known.push((sender.session, key));
            // A client that went away between these lines needs no waking.
            let _ = self.notifier.notify_single_listener(&key);
        }
    }

    fn find(&self, sender: Sender, client_token: u64) -> Option<ListenerKey> {
        let name = listener_name(client_token)?;
        let mut found = None;
        self.notifier.for_each_listener(|listener, details| {
            if details.listener_name == name && details.node_id.value() == sender.session {
                found = Some(listener.listener_key());
                return CallbackProgression::Stop;
            }
            CallbackProgression::Continue
        });
        found
    }
}
