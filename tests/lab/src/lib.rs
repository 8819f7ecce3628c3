//! The laboratory of pairmask: measurements on which choices rest, and stress tests of engines. No
//! code that serves a client depends on it.
//!
//! `README.md` lists the modules, and documents the fields of reports.
// Not published: a comment stands where a name does not say it all.
#![allow(missing_docs)]

pub mod cli;
mod gpu_stages;
mod processes;
pub mod programs;
pub mod sabotage;
mod soak;
pub mod stress;
pub mod study;

pub use pairmaskd::cli::program::{Fault, Result};
