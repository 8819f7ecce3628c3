//! Fuzz targets: one a kind of input, each a function that takes any bytes and does not panic.
//!
//! ```text
//! requests    the header and payload of a request, as a daemon copies, checks and reads them
//! replies     the header and payload of an answer, as a client does
//! masks       a mask that another process has written, by every decoder
//! edits       edits of a scene, beside the naive model
//! questions   queries and casts of a scene, beside the naive model
//! files       saved scenes, files of objects, the configuration, options, names, the record and the status file of an
//!             instance
//! recordings  the file of a recording
//! culls       objects and rules of a frame, by every engine
//! ```
//!
//! `requests`, `replies`, `files` and `recordings` read their input as it would come. For the others what is checked
//! lies behind lengths and indices that have to fit one another, so they make these from [short](input) numbers, among
//! them the extreme ones.
// Not published; a target that fails panics.
#![allow(missing_docs, clippy::missing_panics_doc)]

pub mod culls;
pub mod edits;
pub mod files;
pub mod input;
pub mod masks;
pub mod questions;
pub mod recordings;
pub mod replies;
pub mod requests;
mod scene_file;

/// The name of a target, which its corpus has too, and what it does with an input.
pub type Target = (&'static str, fn(&[u8]));

pub const TARGETS: [Target; 8] = [
    ("culls", culls::decode),
    ("edits", edits::decode),
    ("files", files::decode),
    ("masks", masks::decode),
    ("questions", questions::decode),
    ("recordings", recordings::decode),
    ("replies", replies::decode),
    ("requests", requests::decode),
];
