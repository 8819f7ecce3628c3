//! Tests of the binary as users run it: output, files, exit status, and that no file is left
//! behind.

mod accuracy;
mod audit;
mod engine_benches;
mod load;
mod mistakes;
mod papers;
mod stress;
mod support;
