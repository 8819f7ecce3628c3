//! The auditor: a share of the frames is checked again with the oracle, in the background.
//!
//! What it costs a frame that is drawn: before the reply is sent, the bits of a window of the mask
//! are copied, at most 256 KiB, with the order of that window; after it is sent, the boxes of the
//! window are, at most 0.9 MB. No reply waits for a check: while the auditor is busy with two
//! windows, frames that are drawn are counted as skipped. Other frames cost one random number.
//!
//! Up to 2,048 boxes the window is the whole frame. Beyond, it is some rows against some columns of
//! the mask, drawn at random, since comparing all pairs naively takes longer than frames do. Spheres
//! are compared in exact rational arithmetic, a microsecond a pair: up to 256 of them the window is
//! the whole frame, and a larger frame's window has a 64th of the pairs that one of boxes has.
//!
//! The boxes or spheres are read when the reply is on its way: a client that writes to a frame which it has
//! submitted may spoil its own audit.
//!
//! ```text
//! window         which rows and columns, and their bits           (pure)
//! check          bits against the oracle                          (pure)
//! sphere_oracle  two spheres, in exact rational arithmetic        (pure)
//! thread         hands windows over and keeps the counts
//! ```

mod check;
mod rate;
pub mod sphere_oracle;
mod thread;
mod window;

pub use check::{Outcome, check};
pub use rate::{AuditRate, BadRate};
pub use thread::Auditor;
pub use window::{Reach, Span2, Window};
