//! Requests as they come from the transport.

use std::sync::Arc;

use pairmask_transport::{ActiveRequest, PortTurn, Server};

use super::{Gate, Incoming};

/// Receives requests and lets them in. One thread does so at a time.
pub struct Intake {
    server: Server,
    turn: Arc<PortTurn>,
    gate: Gate,
    /// Requests that were received before this one listened.
    early: Vec<ActiveRequest>,
}

impl Intake {
    /// Of a port that is used in such turns, of which these requests were received already.
    pub fn new(server: Server, turn: Arc<PortTurn>, gate: Gate, early: Vec<ActiveRequest>) -> Self {
        Self { server, turn, gate, early }
    }

    /// Receives at most `most` requests, and gives those that are let in to `each`.
    pub fn receive(&mut self, most: usize, mut each: impl FnMut(Incoming)) {
        let early = self.early.drain(..);
        early.filter_map(|request| self.gate.admit(request)).for_each(&mut each);
        for _ in 0..most {
            match self.turn.take(|| self.server.receive()) {
                Ok(Some(request)) => {
                    if let Some(incoming) = self.gate.admit(request) {
                        each(incoming);
                    }
                }
                Ok(None) => return,
                Err(error) => {
                    // A client that died while it connected; the janitor takes the rest away.
                    log::debug!("receiving requests: {error:?}");
                    return;
                }
            }
        }
    }

    /// Forgets the ports that are gone.
    pub fn tidy(&mut self) {
        self.gate.tidy();
    }
}
