//! The binary, as its users run it: output, files, exit status, signals. Nothing is left behind.
#![allow(clippy::unwrap_used)]

mod accuracy;
mod audit;
mod bench;
mod calibrate;
mod cull;
mod demo;
mod engine_benches;
mod explain;
mod mistakes;
mod serve;
mod settings;
mod status;
mod stress;
mod support;
