//! Requests in hand: what is let in, and whose turn it is.

mod gate;
mod inbox;

pub use gate::{Gate, Incoming};
pub use inbox::Inbox;
