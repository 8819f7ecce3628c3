//! The pairmask daemon as a library: ingest, requests, execute, publish, and what the command line, the
//! benches and the tests share.
// Whether a device of wgpu may go to another thread is found out through 130 types, one within the other.
#![recursion_limit = "256"]

pub mod audit;
pub mod cli;
mod clients;
pub mod execute;
pub mod explain;
pub mod file_error;
mod ingest;
pub mod precision;
mod publish;
mod requests;
pub mod scene;
pub mod serve;
pub mod spawn;
pub mod timed_client;
