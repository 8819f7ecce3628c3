//! Boxes into memory like that of a frame: sources, sizes, threads and stores.
//!
//! Three shared mappings take turns, as a session's frames do, so that a large frame is in no cache
//! when it is written. GB/s counts the bytes of the boxes written, not those read.
//!
//! `cargo bench -p pairmask-tests --bench write_boxes [-- N..]`
#![allow(unsafe_code)]

use std::hint::black_box;
use std::num::NonZeroUsize;
use std::ptr::NonNull;
use std::time::Instant;

use glam::{Affine3A, Vec3};
use pairmask_core::Aabb;
use pairmask_core::aabb::AABB_BYTES;
use pairmask_core::update::Transformed;
use pairmask_core::write::{BoxSource, CenterHalf, Columns, MinMax, Stores, Way};
use rayon::ThreadPoolBuilder;
use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};

/// Frames a row: an odd number, so that the median is one of them.
const FRAMES: usize = 31;
/// Mappings that take turns: a frame being filled, one under way, one being read.
const MAPPINGS: usize = 3;
/// Sizes where none is named.
const SIZES: [usize; 4] = [1000, 10_000, 100_000, 1_000_000];

fn main() {
    let named: Vec<usize> = std::env::args().filter_map(|size| size.parse().ok()).collect();
    let sizes = if named.is_empty() { SIZES.to_vec() } else { named };
    let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let doubled = |threads: &usize| Some(2 * threads).filter(|threads| *threads <= cores);
    let threads: Vec<usize> = std::iter::successors(Some(1), doubled).collect();
    println!(
        "{:<16} {:>9} {:>7} {:<9} {:>9} {:>7}",
        "source", "n", "threads", "stores", "median ms", "GB/s"
    );
    for n in sizes {
        let objects = Objects::new(n);
        let mut mappings: [Mapping; MAPPINGS] = std::array::from_fn(|_| Mapping::new(n));
        for &threads in &threads {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut row = Row { n, threads, mappings: &mut mappings };
            pool.install(|| objects.rows(&mut row));
        }
    }
}

/// The same boxes in every layout.
struct Objects {
    boxes: Vec<Aabb>,
    min: [Vec<f32>; 3],
    max: [Vec<f32>; 3],
    center: [Vec<f32>; 3],
    half: [Vec<f32>; 3],
    points: [Vec<[f32; 3]>; 4],
    locals: Vec<Aabb>,
    transforms: Vec<[[f32; 3]; 4]>,
}

impl Objects {
    fn new(n: usize) -> Self {
        let coordinate = |i: usize, axis: usize| (i * 7919 * (axis + 1) % 100_003) as f32 * 0.01;
        let point = |i: usize| [0, 1, 2].map(|axis| coordinate(i, axis));
        let center: Vec<[f32; 3]> = (0..n).map(point).collect();
        let half = vec![[0.5; 3]; n];
        let boxes: Vec<Aabb> =
            center.iter().zip(&half).map(|(c, h)| Aabb::from_center_half(*c, *h)).collect();
        let min: Vec<_> = boxes.iter().map(|b| b.min).collect();
        let max: Vec<_> = boxes.iter().map(|b| b.max).collect();
        let turned = |c: &[f32; 3]| {
            Affine3A::from_rotation_y(c[0]) * Affine3A::from_translation(Vec3::from(*c))
        };
        Self {
            transforms: center.iter().map(|c| columns_of(turned(c))).collect(),
            locals: vec![Aabb { min: [-0.5; 3], max: [0.5; 3] }; n],
            boxes,
            min: columns(&min),
            max: columns(&max),
            center: columns(&center),
            half: columns(&half),
            points: [min, max, center, half],
        }
    }

    fn rows(&self, row: &mut Row<'_>) {
        let [min, max, center, half] = &self.points;
        row.measure("boxes", &self.boxes);
        row.measure("min-max columns", &MinMax::columns(lend(&self.min), lend(&self.max)));
        row.measure("min-max points", &MinMax::points(min, max));
        row.measure("center columns", &CenterHalf::columns(lend(&self.center), lend(&self.half)));
        row.measure("center points", &CenterHalf::points(center, half));
        row.measure("transforms", &Transformed::new(&self.locals, &self.transforms));
    }
}

fn columns(points: &[[f32; 3]]) -> [Vec<f32>; 3] {
    [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect())
}

fn lend(columns: &[Vec<f32>; 3]) -> Columns<'_> {
    columns.each_ref().map(Vec::as_slice)
}

fn columns_of(affine: Affine3A) -> [[f32; 3]; 4] {
    affine.to_cols_array_2d()
}

/// Memory shared between processes, every page present.
struct Mapping {
    base: NonNull<Aabb>,
    n: usize,
}

// SAFETY: no other thread has a reference to the mapping.
unsafe impl Send for Mapping {}

impl Mapping {
    fn new(n: usize) -> Self {
        let (protection, flags) =
            (ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED | MapFlags::POPULATE);
        // SAFETY: a new mapping at an address of the kernel's choice.
        let base =
            unsafe { mmap_anonymous(std::ptr::null_mut(), n * AABB_BYTES, protection, flags) };
        let base = NonNull::new(base.expect("memory").cast()).expect("no mapping at address 0");
        Self { base, n }
    }

    fn boxes(&mut self) -> &mut [Aabb] {
        // SAFETY: the mapping holds `n` boxes, which any bytes are, and has no other reference.
        unsafe { std::slice::from_raw_parts_mut(self.base.as_ptr(), self.n) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `new` with this length, and not referred to any more.
        let unmapped = unsafe { munmap(self.base.as_ptr().cast(), self.n * AABB_BYTES) };
        unmapped.expect("a mapping");
    }
}

/// What the rows of a pool have in common.
struct Row<'a> {
    n: usize,
    threads: usize,
    mappings: &'a mut [Mapping; MAPPINGS],
}

impl Row<'_> {
    /// A line by each kind of stores; `*` marks what [`Way::of`] chooses.
    fn measure<S: BoxSource + Sync>(&mut self, name: &str, source: &S) {
        let chosen = Way::of::<S>(self.n, self.threads);
        for stores in [Stores::Cached, Stores::Streaming] {
            let way = Way { stores, ..chosen };
            let mut times: Vec<_> = (0..FRAMES)
                .map(|frame| {
                    let out = self.mappings[frame % MAPPINGS].boxes();
                    let start = Instant::now();
                    way.write(black_box(source), out);
                    black_box(out);
                    start.elapsed().as_nanos()
                })
                .collect();
            times.sort_unstable();
            let median = times[FRAMES / 2] as f64;
            let stores = format!("{stores:?}{}", if way == chosen { "*" } else { "" });
            println!(
                "{name:<16} {:>9} {:>7} {stores:<9} {:>9.4} {:>7.1}",
                self.n,
                self.threads,
                median / 1e6,
                (self.n * AABB_BYTES) as f64 / median
            );
        }
    }
}
