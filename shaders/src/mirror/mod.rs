//! The grid's stages on the CPU: what each leaves behind, word for word. Slow and plain. The tests compare the GPU's
//! reply with it, byte by byte.
//!
//! `grid_cells` and `grid_pairs` are files named like their shaders; `grid_scan` and `grid_slot` are a few lines here.
//! `grid_scatter` leaves the boxes of a cell in any order, which `grid_slot` settles, and `grid_write` copies the words
//! or pairs of `grid_pairs` as they are.

mod grid_cells;
pub mod grid_layout;
mod grid_pairs;
pub mod sphere_bounds;
pub mod sphere_exact;
pub mod sphere_filter;

use pairmask_core::Sphere;
use pairmask_core::aabb::{BoxClass, KeyBox};
use pairmask_core::precision::BoxSlice;

use crate::layouts::GridLayout;

/// What a frame leaves behind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mirrored {
    /// Box at each position.
    pub order: Vec<u32>,
    /// Row, column block and bits of each non-zero word.
    pub words: Vec<[u32; 3]>,
    /// The pairs of a list, in the order of those words: smaller and larger box.
    pub pairs: Vec<[u32; 2]>,
    /// Pairs compared.
    pub compared: u64,
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
    // `grid_scan`.
    let mut starts = vec![0; layout.cell_end as usize + 1];
    for home in &homes {
        starts[home.cell as usize] += 1;
    }
    let mut sum = 0;
    for start in &mut starts {
        sum += std::mem::replace(start, sum);
    }
    // `grid_slot`: by cell, then by index.
    let mut order: Vec<u32> = (0..homes.len() as u32).collect();
    order.sort_by_key(|index| homes[*index as usize].cell);
    let mut mirrored = Mirrored { order, ..Mirrored::default() };
    grid_pairs::find(layout, keys, overlap, &homes, &starts, &mut mirrored);
    mirrored
}
