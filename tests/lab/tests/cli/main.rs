//! The binary, as its users run it: output, files, exit status. Nothing is left behind.
#![allow(clippy::unwrap_used)]

mod accuracy;
mod audit;
mod engine_benches;
mod mistakes;
mod stress;
mod support;
