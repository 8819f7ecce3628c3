//! Requests in hand: what is let in, and whose turn it is.

mod intake;
mod queue;

pub use self::intake::{Incoming, Intake};
pub use self::queue::{RequestQueue, Resource};
