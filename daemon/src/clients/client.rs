//! A client: one session, through however many ports.

use iceoryx2::port::notifier::ListenerKey;
use iceoryx2::prelude::CallbackProgression;
use pairmask_transport::{WakeClient, listener_name};

/// What is kept of a client. Everything that belongs to one session and outlives a request goes here.
#[derive(Debug)]
pub(super) struct Client {
    session: u128,
    /// What wakes it, once it was found.
    listener: Option<ListenerKey>,
    /// Pairs in its last frame, once it had one.
    pub(super) last_pairs: Option<u64>,
}

impl Client {
    /// A client of which nothing is known yet.
    pub(super) const fn new(session: u128) -> Self {
        Self { session, listener: None, last_pairs: None }
    }

    /// Its session, by the transport's number of the node.
    pub(super) const fn session(&self) -> u128 {
        self.session
    }

    /// Wakes this client alone, by the listener of its session that bears this token. About 50 ns
    /// while it does not sleep.
    pub(super) fn wake(&mut self, notifier: &WakeClient, client_token: u64) {
        if let Some(listener) = &self.listener
            && notifier.notify_single_listener(listener).is_ok()
        {
            return;
        }
        self.listener = self.find_listener(notifier, client_token);
        if let Some(listener) = &self.listener {
            // A client that went away between these lines needs no waking.
            let _ = notifier.notify_single_listener(listener);
        }
    }

    fn find_listener(&self, notifier: &WakeClient, client_token: u64) -> Option<ListenerKey> {
        let name = listener_name(client_token)?;
        let mut found = None;
        notifier.for_each_listener(|listener, details| {
            if details.listener_name == name && details.node_id.value() == self.session {
                found = Some(listener.listener_key());
                return CallbackProgression::Stop;
            }
            CallbackProgression::Continue
        });
        found
    }
}
