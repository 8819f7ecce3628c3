//! What is let in: requests whose sender and length the transport and the kernel vouch for.

use std::collections::VecDeque;
use std::sync::Arc;

use pairmask_transport::{
    ActiveRequest, CheckedRequest, ForgedRequest, PortTurn, Segment, SegmentFiles, Sender, Server,
    Services,
};

/// Forged requests that are kept, at most. A port has three requests at a time: one that forged as many
/// is not received again until others did.
const MOST_KEPT: usize = 48;

#[derive(Debug)]
pub struct Incoming {
    pub sender: Sender,
    pub request: CheckedRequest,
}

#[derive(Debug)]
struct Port {
    sender: Sender,
    segment: Segment,
    /// The last token that it was found to have a right to.
    token: Option<u64>,
}

/// Receives requests and lets them in, or not. One thread does so at a time.
pub struct Intake {
    server: Server,
    turn: Arc<PortTurn>,
    services: Arc<Services>,
    files: SegmentFiles,
    ports: Vec<Port>,
    /// Forged requests. Dropping one would inform the client that it names that its request has no
    /// server any more.
    forged: VecDeque<ActiveRequest>,
    early: Vec<ActiveRequest>,
}

impl Intake {
    /// Of a port that is used in such turns, and whose first requests were received already.
    pub fn new(
        server: Server,
        turn: Arc<PortTurn>,
        services: Arc<Services>,
        files: SegmentFiles,
        early: Vec<ActiveRequest>,
    ) -> Self {
        let (ports, forged) = (Vec::new(), VecDeque::new());
        Self { server, turn, services, files, ports, forged, early }
    }

    pub fn receive(&mut self, most: usize, mut each: impl FnMut(Incoming)) {
        for request in std::mem::take(&mut self.early) {
            self.admit(request).into_iter().for_each(&mut each);
        }
        for _ in 0..most {
            match self.turn.take(|| self.server.receive()) {
                Ok(Some(request)) => self.admit(request).into_iter().for_each(&mut each),
                Ok(None) => return,
                Err(error) => {
                    // A client that died while it connected; the janitor takes the rest away.
                    log::debug!("receiving requests: {error:?}");
                    return;
                }
            }
        }
    }

    /// Checks a request. One that lies about where it comes from is not let in, and never answered.
    fn admit(&mut self, request: ActiveRequest) -> Option<Incoming> {
        match self.check(request) {
            Ok(incoming) => Some(incoming),
            Err(ForgedRequest { request }) => {
                log::debug!("port {:x} forges requests", request.origin().value());
                if self.forged.len() >= MOST_KEPT {
                    self.forged.pop_front();
                }
                self.forged.push_back(request);
                None
            }
        }
    }

    pub fn tidy(&mut self) {
        if self.ports.is_empty() {
            return;
        }
        let ports = &mut self.ports;
        let mut known = 0;
        // Those that are still there come to the front.
        self.services.for_each_sender(|sender| {
            if let Some(at) = ports[known..].iter().position(|port| port.sender == sender) {
                ports.swap(known, known + at);
                known += 1;
            }
        });
        ports.truncate(known);
    }

    fn check(&mut self, request: ActiveRequest) -> Result<Incoming, ForgedRequest> {
        let address = CheckedRequest::address(&request);
        let Some(port) = self.port(request.origin().value(), address) else {
            return Err(ForgedRequest { request });
        };
        let (sender, token) = (port.sender, port.token);
        let request = CheckedRequest::new(request, &port.segment)?;
        let asked = Some(request.header().client_token);
        if token != asked {
            // A listener's name belongs to its session: only that session may ask for answers to it.
            let owner = self.services.session_named(request.header().client_token);
            if owner.is_some_and(|session| session != sender.session) {
                return Err(request.into_forged());
            }
            if let Some(port) = self.ports.iter_mut().find(|port| port.sender == sender) {
                port.token = asked;
            }
        }
        Ok(Incoming { sender, request })
    }

    /// What is known of a port that sends from `address`; `None` where that is not in its segment.
    fn port(&mut self, port: u128, address: usize) -> Option<&Port> {
        let at = if let Some(at) = self.ports.iter().position(|known| known.sender.port == port) {
            if !self.ports[at].segment.holds(address, 1) {
                // Mapped anew, or forged.
                self.ports[at].segment = self.files.find(port, address)?;
            }
            at
        } else {
            let segment = self.files.find(port, address)?;
            let mut sender = Sender { port, session: port, process: 0 };
            self.services.for_each_sender(|known| {
                if known.port == port {
                    sender = known;
                }
            });
            self.ports.push(Port { sender, segment, token: None });
            self.ports.len() - 1
        };
        self.ports.get(at)
    }
}
