//! Studies: measurements on which choices rest. No code that serves a client depends on them.

pub mod accuracy;
pub mod grid;
pub mod harness;
pub mod judge;
pub mod mapping;
pub mod moving;
pub mod papers;
pub mod spheres;
pub mod sweep;
pub mod threads;
pub mod ways;
