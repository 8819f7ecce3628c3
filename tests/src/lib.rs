//! Oracle, conformance suite and fault tests of pairmask.

pub mod conformance;
pub mod naive_decoder;
pub mod oracle;
pub mod stress_scenes;
