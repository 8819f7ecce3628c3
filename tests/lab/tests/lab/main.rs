//! The laboratory's command line as users run it: output, files, exit status, and that no file is left behind.
#![allow(clippy::unwrap_used)]

mod accuracy;
mod audit;
mod engine_benches;
mod load;
mod mistakes;
mod papers;
mod soak;
mod stress;
mod support;
