//! The pairmask daemon as a library: ingest, requests, execute, publish, and what the command line, the
//! benches and the tests share.
// Whether a device of wgpu may go to another thread is found out through 130 types, one within the other.
#![recursion_limit = "256"]
// A library for this package's binary, its tests and the laboratory: what a name, a signature or an error's message says
// is not said again.
#![allow(missing_docs, clippy::missing_errors_doc)]

pub mod advise;
pub mod audit;
pub mod cli;
mod clients;
pub mod daemon_cpu;
pub mod execute;
pub mod explain;
pub mod file_error;
mod ingest;
pub mod percentiles;
pub mod precision;
mod publish;
pub mod recording;
pub mod replay;
mod requests;
pub mod scene;
pub mod serve;
pub mod shown;
pub mod spawn;
pub mod timed_client;

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a mutex guards, also after a thread panicked with it: a thread that may not go on then has ended the process.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The path in an environment variable that is set and not empty.
fn path_in(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// Our folder below [`user_base`].
fn user_folder(variable: &str, in_home: &str) -> Option<PathBuf> {
    Some(user_base(variable, in_home)?.join("pairmask"))
}

/// The folder that a variable names, else a folder of the user's home.
fn user_base(variable: &str, in_home: &str) -> Option<PathBuf> {
    path_in(variable).or_else(|| Some(path_in("HOME")?.join(in_home)))
}
