//! The grid's stages on the CPU: what each leaves behind, word for word.
//!
//! One file a stage, named like its shader. Slow and plain. The tests compare the GPU's reply with
//! it, byte by byte. Two stages have none of their own: `grid_scatter` leaves the boxes of a cell in
//! any order, which `grid_place` settles, and `grid_write` copies the words or pairs of `grid_pairs` as
//! they are.

mod grid_cells;
pub mod grid_layout;
mod grid_pairs;
mod grid_place;
mod grid_scan;
pub mod sphere_bounds;
pub mod sphere_exact;
pub mod sphere_filter;

use pairmask_core::aabb::{BoxClass, KeyBox};
use pairmask_core::precision::BoxSlice;
use pairmask_core::{Aabb, Sphere};

pub use self::grid_cells::Home;
use crate::layouts::GridLayout;

/// What a frame leaves behind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mirrored {
    /// Home of each box.
    pub homes: Vec<Home>,
    /// First position of each cell, then n.
    pub starts: Vec<u32>,
    /// Box at each position.
    pub order: Vec<u32>,
    /// Row, column block and bits of each non-zero word.
    pub words: Vec<[u32; 3]>,
    /// The pairs of a list, in the order of those words: smaller and larger box.
    pub pairs: Vec<[u32; 2]>,
    /// Pairs compared.
    pub compared: u64,
}

/// The home cell of a box, in the table of all levels; for what has none of its own, the first that such
/// boxes have.
pub fn home_cell(layout: &GridLayout, b: &Aabb) -> u32 {
    grid_cells::homes(layout, &[KeyBox::classify(b)]).first().map_or(0, |home| home.cell)
}

/// All stages, for a layout that the host chose.
pub fn frame(layout: &GridLayout, boxes: BoxSlice<'_>) -> Mirrored {
    let expanded = (0..boxes.len()).filter_map(|i| boxes.get(i));
    let keys: Vec<(KeyBox, BoxClass)> = expanded.map(|b| KeyBox::classify(&b)).collect();
    of_keys(layout, &keys, &|a, b| keys[a].0.overlaps(&keys[b].0))
}

/// The same for spheres: the boxes around them have cells, and they themselves are tested.
pub fn sphere_frame(layout: &GridLayout, spheres: &[Sphere]) -> Mirrored {
    let keys: Vec<(KeyBox, BoxClass)> = spheres.iter().map(sphere_bounds::classify).collect();
    of_keys(layout, &keys, &|a, b| sphere_exact::meet(&spheres[a], &spheres[b]))
}

fn of_keys(
    layout: &GridLayout,
    keys: &[(KeyBox, BoxClass)],
    overlap: &dyn Fn(usize, usize) -> bool,
) -> Mirrored {
    let homes = grid_cells::homes(layout, keys);
    let starts = grid_scan::starts(layout, &homes);
    let order = grid_place::order(&homes);
    let mut mirrored = Mirrored { homes, starts, order, ..Mirrored::default() };
    grid_pairs::find(layout, keys, overlap, &mut mirrored);
    mirrored
}
