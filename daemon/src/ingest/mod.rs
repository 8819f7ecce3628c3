//! Requests in hand: what is let in, and whose turn it is.

mod gate;
mod inbox;
mod intake;

pub use gate::{Gate, Incoming};
pub use inbox::{Inbox, Resource};
pub use intake::Intake;
