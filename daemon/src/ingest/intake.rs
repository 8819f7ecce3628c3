//! What is let in: requests of clients whose memory the kernel vouches for.

use std::sync::Arc;

use pairmask_transport::{CheckedRequest, Door, Peer, Sender, TransportError};
use std::time::Instant;

#[derive(Debug)]
pub struct Incoming {
    pub sender: Sender,
    pub request: CheckedRequest,
}

/// Receives requests. One thread does so at a time.
pub struct Intake {
    door: Arc<Door>,
    peers: Vec<Arc<Peer>>,
    /// Of the door, when the list was made.
    changes: Option<u64>,
}

impl Intake {
    /// Of the clients behind a door.
    pub fn new(door: Arc<Door>) -> Self {
        Self { door, peers: Vec::new(), changes: None }
    }

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
        for peer in &self.peers {
            peer.receive(|request| each(Incoming { sender: request.sender(), request }));
        }
    }

    /// Sleeps until a client sends, or until then.
    pub fn sleep_until(&self, until: Instant) -> Result<(), TransportError> {
        self.door.sleep_until(&self.peers, until)
    }
}
