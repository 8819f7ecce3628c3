//! Oracle, conformance suite and fault tests of pairmask.

pub mod conformance;
pub mod daemon;
pub mod naive_decoder;
pub mod oracle;
pub mod session_engine;
pub mod stress_scenes;
