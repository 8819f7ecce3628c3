//! What the daemon keeps of its clients, by session.
//!
//! A session is who the transport's registers say that a request comes from ([`Sender`]); its token
//! is an echo. Nothing here is needed for a right answer: what was forgotten is found again, or
//! estimated.

mod known;

use iceoryx2::port::notifier::ListenerKey;
use iceoryx2::prelude::CallbackProgression;
use pairmask::transport::{Sender, WakeClient, listener_name};

use self::known::Known;

/// The clients, and the port that wakes them.
pub(crate) struct Clients {
    notifier: WakeClient,
    known: Known,
}

impl Clients {
    /// Of an instance that at most `max_clients` connect to.
    pub(crate) fn new(notifier: WakeClient, max_clients: usize) -> Self {
        Self { notifier, known: Known::new(max_clients) }
    }

    /// Pairs in a session's last frame, for the plan of its next; `None` where it had none.
    pub(crate) fn last_pairs(&self, session: u128) -> Option<u64> {
        self.known.find(session)?.last_pairs
    }

    /// Notes the pairs of a session's frame.
    pub(crate) fn note_pairs(&mut self, session: u128, pair_count: u64) {
        self.known.of(session).last_pairs = Some(pair_count);
    }

    /// Wakes a sender, by the listener of its session that bears its token, and nobody else. About
    /// 50 ns while it does not sleep.
    pub(crate) fn wake(&mut self, sender: Sender, client_token: u64) {
        let client = self.known.of(sender.session);
        if let Some(listener) = client.listener.take()
            && self.notifier.notify_single_listener(&listener).is_ok()
        {
            client.listener = Some(listener);
            return;
        }
        if let Some(listener) = find_listener(&self.notifier, sender, client_token) {
            client.listener = Some(listener);
            // A client that went away between these lines needs no waking.
            let _ = self.notifier.notify_single_listener(&listener);
        }
    }
}

fn find_listener(notifier: &WakeClient, sender: Sender, client_token: u64) -> Option<ListenerKey> {
    let name = listener_name(client_token)?;
    let mut found = None;
    notifier.for_each_listener(|listener, details| {
        if details.listener_name == name && details.node_id.value() == sender.session {
            found = Some(listener.listener_key());
            return CallbackProgression::Stop;
        }
        CallbackProgression::Continue
    });
    found
}
