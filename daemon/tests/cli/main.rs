//! The binary, as its users run it: output, files, exit status, signals. Nothing is left behind.
#![allow(clippy::unwrap_used)]

mod audit;
mod bench;
mod calibrate;
mod cull;
mod demo;
mod explain;
mod mistakes;
mod serve;
mod settings;
mod status;
mod support;
