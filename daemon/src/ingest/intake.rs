//! Requests as they come from the transport.

use std::sync::Arc;

use pairmask_transport::{PortTurn, Server};

use super::{Gate, Incoming};

/// Receives requests and lets them in. One thread does so at a time.
pub struct Intake {
    server: Server,
    turn: Arc<PortTurn>,
    gate: Gate,
}

impl Intake {
    /// Of a port that is used in such turns.
    pub fn new(server: Server, turn: Arc<PortTurn>, gate: Gate) -> Self {
        Self { server, turn, gate }
    }

    /// Receives at most `most` requests, and gives those that are let in to `each`.
    pub fn receive(&mut self, most: usize, mut each: impl FnMut(Incoming)) {
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
