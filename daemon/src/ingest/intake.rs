//! What is let in: requests of clients whose memory the kernel vouches for.

use std::sync::Arc;

use pairmask_transport::{CheckedRequest, Door, Peer, Sender, TransportError};
use std::time::Instant;

#[derive(Debug)]
pub struct Incoming {
    pub received_at: Instant,
    pub sender: Sender,
    pub request: CheckedRequest,
}

/// Receives requests. One thread does so at a time.
pub struct Intake {
    door: Arc<Door>,
    peers: Vec<Arc<Peer>>,
    /// What one look has found, and when that was sent.
    found: Vec<(u64, Incoming)>,
    /// Of the door, when the list was made.
    changes: Option<u64>,
}

impl Intake {
    /// Of the clients behind a door.
    pub fn new(door: Arc<Door>) -> Self {
        Self { door, peers: Vec::new(), found: Vec::new(), changes: None }
    }

    /// Gives what has come in the order in which it was sent, and that of one client in the order of its numbers.
    pub fn receive(&mut self, mut each: impl FnMut(Incoming)) {
        let changes = Some(self.door.changes());
        if self.changes != changes {
            self.peers = self.door.peers();
            self.changes = changes;
            // From now on somebody looks at their boards.
            for peer in &self.peers {
                peer.wakes_up();
            }
        }
        let Self { peers, found, .. } = self;
        for peer in peers.iter() {
            let mut last = 0;
            peer.receive(|request| {
                last = request.sent_at().max(last);
                let (received_at, sender) = (Instant::now(), request.sender());
                found.push((last, Incoming { received_at, sender, request }));
            });
        }
        found.sort_by_key(|(sent_at, _)| *sent_at);
        found.drain(..).for_each(|(_, incoming)| each(incoming));
    }

    /// Sleeps until a client sends, or until then.
    pub fn sleep_until(&self, until: Instant) -> Result<(), TransportError> {
        self.door.sleep_until(&self.peers, until)
    }
}
