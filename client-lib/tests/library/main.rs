//! The library as its users see it, in process, and its book.
#![allow(clippy::unwrap_used, clippy::missing_panics_doc)]

mod book;
mod in_process;
mod scenes;
