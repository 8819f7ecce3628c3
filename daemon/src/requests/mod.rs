//! What is done with a request: validated once, then given to the file of its operation.
//!
//! An operation is a file here and an arm in [`Responder::take`].

mod cull;
mod status;

use std::rc::Rc;

use iceoryx2::service::ipc;
use pairmask_transport::{Limits, Services, WakeClient};
use pairmask_wire::{Request, StatusBody};

use self::cull::Culls;
use crate::audit::Auditor;
use crate::clients::Clients;
use crate::execute::Executor;
use crate::ingest::Incoming;
use crate::publish::{AlterAnswer, OpenRequest, Outbox, ReplyLender};

/// Answers requests: one at a time, but for frames that a GPU takes its time for.
pub struct Responder {
    culls: Culls,
    outbox: Outbox,
    lender: Rc<ReplyLender>,
}

impl Responder {
    /// A responder to the clients of these services.
    pub fn new(
        services: Rc<Services<ipc::Service>>,
        wake_clients: WakeClient,
        limits: &Limits,
        executor: Executor,
        auditor: Auditor,
    ) -> Self {
        let clients = Clients::new(wake_clients, limits.max_clients);
        Self {
            culls: Culls::new(executor),
            outbox: Outbox::new(services, clients, auditor),
            lender: Rc::new(ReplyLender::new(limits.max_reply_bytes)),
        }
    }

    /// Changes every answer from now on, or none. For tests of the auditor.
    pub fn alter_answers(&mut self, alter: Option<AlterAnswer>) {
        self.outbox.alter_answers(alter);
    }

    /// Takes in one request, whatever it holds, and answers it now, or leaves it under way.
    pub fn take(&mut self, incoming: Incoming) {
        let mut open = OpenRequest::new(incoming, Rc::clone(&self.lender));
        match open.parse() {
            Ok(Request::Cull(request)) => self.culls.take(open, &request, &mut self.outbox),
            Ok(Request::Status) => status::answer(&mut open, &mut self.outbox),
            Err(reject) => self.outbox.refuse(&mut open, &reject.into()),
        }
    }

    /// Whether another request can be taken in.
    pub fn has_room(&self) -> bool {
        self.culls.has_room()
    }

    /// Whether a frame is under way: then [`Self::publish_ended`] is to be called soon.
    pub fn is_busy(&self) -> bool {
        self.culls.is_busy()
    }

    /// Publishes the oldest frame under way if it has ended. Whether it had.
    pub fn publish_ended(&mut self) -> bool {
        self.culls.publish_ended(&mut self.outbox)
    }

    /// Lets the engines work for a moment.
    pub fn rest(&mut self) {
        self.culls.rest();
    }

    /// Gives up what belonged to clients that are gone; to be called now and then.
    pub fn tidy(&mut self) {
        self.culls.tidy();
    }

    /// What the daemon has done so far.
    pub fn status(&self) -> StatusBody {
        self.outbox.status()
    }

    /// Threads that the engine of the last answer could use.
    pub fn threads(&self) -> usize {
        self.outbox.threads()
    }
}
