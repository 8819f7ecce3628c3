//! Answers on their way out: the memory of a reply, what goes with it, and who is woken.

mod frame_memory;
mod open_request;
mod outbox;
mod refusal;

pub(crate) use self::open_request::OpenRequest;
pub use self::outbox::AlterAnswer;
pub(crate) use self::outbox::{Found, Outbox};
pub(crate) use self::refusal::Refusal;
