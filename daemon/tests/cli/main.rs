//! Tests of the binary as users run it: output, files, exit status, signals, and that no file is
//! left behind.
#![allow(clippy::unwrap_used)]

mod advise;
mod audit;
mod bench;
mod clean;
mod cull;
mod demo;
mod doctor;
mod explain;
mod generated;
mod gpus;
mod install_service;
mod metrics;
mod mistakes;
mod replay;
mod serve;
mod settings;
mod status;
mod support;
mod top;
