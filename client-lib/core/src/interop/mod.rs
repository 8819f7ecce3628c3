//! Conversions of types of mathematics crates.
//!
//! Corners and centres need no conversion: constructors take `impl Into<[f32; 3]>`, which the
//! vectors of such crates implement in any version. This module converts pairs of vectors and
//! matrices, each crate behind a feature of its name.

#[cfg(feature = "glam")]
mod glam;
#[cfg(feature = "mint")]
mod mint;
