//! Examples of pairmask, one folder each; every one is a binary that runs by itself.
//!
//! * `minimal_client`: boxes in, pairs out.
//! * `falling_boxes`: a small physics loop that uses the pairs.
//! * `several_processes`: four processes write one scene, a fifth listens.

/// The code of the README, so that it is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
mod readme {}
