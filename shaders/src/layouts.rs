//! Structs that both Rust and WGSL touch, made from their text in WGSL when this crate is built (`build.rs`): what
//! their members mean stands there. A test compares each with what naga reflects.

use bytemuck::{Pod, Zeroable};

use crate::constants::{BATCH_WORDS, CAST_LEVELS, GRID_LEVELS, SCENE_SAMPLES};

/// Name and size of a struct, its members and where they lie in it.
#[cfg(test)]
pub(crate) type Layout = (&'static str, usize, &'static [(&'static str, usize)]);

include!(concat!(env!("OUT_DIR"), "/layouts.rs"));

/// What a search of a scene looks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum SceneMode {
    /// Pairs that began or ended since the history began.
    #[default]
    Changes = 0,
    /// Pairs of now with a box that the edit named.
    Moved = 1,
    /// All pairs of now, or queries against all boxes.
    All = 2,
    /// Pairs of a query and a box. The queries are what is set.
    Query = 3,
}
