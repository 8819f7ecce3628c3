//! Studies: measurements on which choices rest. No code that serves a client depends on them.

pub(crate) mod accuracy;
pub(crate) mod advice;
pub(crate) mod grid;
pub(crate) mod harness;
pub(crate) mod judge;
pub(crate) mod mapping;
pub mod moving;
pub(crate) mod papers;
pub mod spheres;
pub(crate) mod threads;
pub(crate) mod ways;
