//! What the daemon keeps of its clients, by session.
//!
//! A session is who the transport's registers say that a request comes from; its token is an echo.
//! Nothing here is needed for a right answer: what was forgotten is found again, or estimated.

mod client;
mod known;

use pairmask_transport::{Sender, WakeClient};

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

    /// Wakes the client that sent a request with this token.
    pub(crate) fn wake(&mut self, sender: Sender, client_token: u64) {
        self.known.of(sender.session).wake(&self.notifier, client_token);
    }
}
