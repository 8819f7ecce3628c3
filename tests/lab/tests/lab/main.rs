//! The laboratory's command line, its studies on a software adapter, and its shaders.
#![allow(clippy::unwrap_used)]

mod cli;
mod gpu_stress;
mod grid_study;
mod mapping_study;
mod sweep_study;
mod wgsl;
