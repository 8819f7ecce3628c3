//! WGSL stages of pairmask, their shared parts, and the layouts both sides agree on.
//!
//! One stage a file under `wgsl/`, shared parts under `wgsl/shared/`; a stage has one name everywhere, and so has what it
//! binds. Numbers that Rust and WGSL both need are declared once, in [`constants`], and injected when a stage is
//! composed ([`Stage::composed`]); structs that both sides touch are declared in WGSL alone, and [`layouts`] is made from
//! that. What a stage leaves behind is computed on the CPU in [`mirror`], for the tests. The arrangement follows vello's
//! shaders.
//!
//! All indices are proven in range by the plan that fills the parameters, because production runs
//! without bounds checks; the tests run the same stages with checks.

// A library for the daemon, its tests and the laboratory: what a name or a signature says is not said again.
#![allow(missing_docs)]

mod compose;
pub mod constants;
pub mod layouts;
pub mod mirror;
#[cfg(test)]
mod wgsl_tests;

pub use compose::{
    ComposedStage, Found, GridStage, PairsVariant, RowsPerThread, Rules, SceneStage, Stage,
    compose, shared_part,
};
