//! Answers on their way out: the memory of a reply, what goes with it, and who is told.

mod counters;
mod frame_memory;
mod open_request;
mod outbox;
mod refusal;
mod reply_memory;

pub(crate) use open_request::{OpenRequest, ReplyLender};
pub use outbox::AlterAnswer;
pub(crate) use outbox::Outbox;
pub(crate) use refusal::Refusal;
