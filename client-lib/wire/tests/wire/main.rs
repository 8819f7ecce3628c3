//! What goes over the wire: golden bytes, round trips, and arbitrary bytes from the other side.
#![allow(clippy::unwrap_used, clippy::missing_panics_doc)]

mod frames;
mod rules;
mod scenes;
mod shared_scenes;
