//! Requests in hand: what is let in, and whose turn it is.

mod gate;
mod inbox;

pub use self::gate::{Incoming, Intake};
pub use self::inbox::{Inbox, Resource};
