//! The binary, as its users run it: output, files, exit status, signals. Nothing is left behind.
#![allow(clippy::unwrap_used)]

mod audit;
mod bench;
mod cull;
mod demo;
mod serve;
mod settings;
mod status;
mod stress;
mod support;
