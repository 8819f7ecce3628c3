//! Where answers go out: counted, sent, their client woken, some of them checked again.

use std::time::Instant;

use pairmask::dispatch::{CullAnswer, StageTimes};
use pairmask::transport::Sender;
use pairmask::wire::{
    Objects, ReplyFields, ResponseHeader, response_error, response_ok, response_status,
};

use super::account::Account;
use super::loan_reply::LoanReply;
use super::wake::WakeBoard;
use super::{AlterAnswer, Failure};
use crate::audit::Auditor;

/// What a request is answered with, when it is not refused.
#[allow(clippy::large_enum_variant)] // A box would be an allocation in every frame.
pub(super) enum Said<'a> {
    /// The daemon's status, which the reply holds.
    Status,
    /// The pairs of these objects, whose mask the reply holds.
    Answer(Objects<'a>, CullAnswer),
}

/// What every answer passes.
pub(super) struct Desk {
    pub(super) wake_board: WakeBoard,
    pub(super) account: Account,
    pub(super) auditor: Auditor,
    /// Changes every answer before it is counted and sent.
    pub(super) alter_answers: Option<AlterAnswer>,
    /// Threads that the engine of the last answer could use.
    pub(super) threads: usize,
}

impl Desk {
    /// Sends the answer to a request of `sender` that was taken in at `start`.
    pub(super) fn publish(
        &mut self,
        sender: Sender,
        fields: &ReplyFields,
        mut reply: LoanReply<'_>,
        said: Result<Said<'_>, Failure>,
        start: Instant,
    ) {
        let mut audited = None;
        let response = match said {
            Ok(Said::Status) => response_status(fields),
            Ok(Said::Answer(objects, mut answer)) => {
                if let Some(alter) = self.alter_answers {
                    alter(reply.words_mut(), &mut answer.report);
                }
                let shape = &answer.report.shape;
                audited = self
                    .auditor
                    .draw(fields, objects.form(), shape, reply.words())
                    .zip(Some(objects));
                let total_ns = start.elapsed().as_nanos() as u64;
                let times = StageTimes { total_ns, ..answer.times };
                self.threads = answer.threads;
                let pair_count = answer.report.pair_count;
                self.account.note_frame(sender.session, fields, objects.form(), pair_count);
                response_ok(fields, answer.engine, answer.threads, &answer.report, &times)
            }
            Err(failure) => {
                log::debug!("client {:016x}: {}", fields.client_token, failure.text);
                self.account.note_error(fields, failure.status);
                response_error(fields, failure.status, failure.detail)
            }
        };
        send(reply, &response);
        self.wake_board.wake(sender, fields.client_token);
        if let Some((window, objects)) = audited {
            // The objects are ours to read as long as the request is.
            self.auditor.submit(window, objects);
        }
    }
}

fn send(reply: LoanReply<'_>, header: &ResponseHeader) {
    // Without memory for even one page, or with a client that is gone, nobody can be told: the
    // client's deadline ends its wait.
    if let Err(error) = reply.send(header) {
        log::debug!("sending a response: {error}");
    }
}
