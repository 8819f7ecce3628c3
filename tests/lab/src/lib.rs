//! The laboratory of pairmask: measurements on which choices rest, and stress tests of engines. No
//! code that serves a client depends on it.
//!
//! ```text
//! study       measurements beside the papers' figures, one folder a question
//! gpu_stages  engines of the GPU, stage by stage, for the studies
//! stress      hard scenes, every engine and mode against the oracle
//! sabotage    engines broken on purpose, to test that the checks notice
//! processes   children that work at the same time
//! cli         the binary `pairmask-lab`
//! ```
//!
//! Fields of reports are documented once, in `README.md`.
// Not published: a comment stands where a name does not say it all.
#![allow(missing_docs)]

pub mod cli;
mod gpu_stages;
mod processes;
pub mod sabotage;
pub mod stress;
pub mod study;

pub use pairmaskd::cli::program::{Fault, Result};
