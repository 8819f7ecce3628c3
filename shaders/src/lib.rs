//! WGSL stages of pairmask, their shared parts, and the layouts both sides agree on.
//!
//! One stage a file under `wgsl/`, shared parts under `wgsl/shared/`; a stage has one name
//! everywhere: file, pipeline label, timing row; and so has what it binds: variable, part of a frame. Numbers that Rust and WGSL both need are declared
//! once, in [`constants`], and injected when a stage is composed ([`Stage::wgsl`]); structs that
//! both sides touch are in [`layouts`], and a test compares them with what naga reflects. What a stage
//! leaves behind is computed on the CPU in [`mirror`], for the tests. The
//! arrangement follows vello's shaders.
//!
//! All indices are proven in range by the plan that fills the parameters, because production runs
//! without bounds checks; the tests run the same stages with checks.

pub mod compose;
pub mod constants;
pub mod layouts;
pub mod mirror;
mod object_parts;
mod share_parts;
#[cfg(test)]
mod wgsl_tests;

pub use compose::{
    ComposeError, ComposedStage, Found, GridStage, PairsVariant, RowsPerThread, Rules, SceneStage,
    Stage, compose, shared_part,
};
