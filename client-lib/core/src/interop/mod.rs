//! Types of mathematics crates as ours.
//!
//! Corners and centres need nothing from here: constructors take `impl Into<[f32; 3]>`, which the
//! vectors of such crates are in any version. What has no array form of its own, a pair of vectors
//! or a matrix, is converted here, each crate behind a feature of its name.

#[cfg(feature = "glam")]
mod glam;
#[cfg(feature = "mint")]
mod mint;
