//! Boxes into the memory of a frame: from packed boxes, from arrays of corners, from arrays of centres
//! and half extents, and (by [`update`](crate::update)) from local boxes and transforms.
//!
//! A frame is written once and then read by another process or device. Two effects make writing slow
//! where a frame is larger than the caches:
//!
//! * A store to a line that is not in a cache first reads the line from memory. Non-temporal stores of
//!   whole lines do not.
//! * One thread cannot keep the memory busy. Large frames are written in parts, on the calling
//!   thread's rayon pool.
//!
//! The choice is by the number of boxes and threads. The boxes are the same regardless of what it chooses,
//! bit for bit; only the payload of a NaN is unspecified.
//!
//! ```
//! use pairmask_core::Aabb;
//! use pairmask_core::write::{CenterHalf, MinMax, par_write_boxes};
//!
//! let (x, y, z) = ([0.0, 2.0], [0.0, 0.0], [5.0, 5.0]);
//! let half = [0.5; 2];
//! let mut boxes = [Aabb::EMPTY; 2];
//! par_write_boxes(&CenterHalf::columns([&x, &y, &z], [&half; 3]), &mut boxes);
//! assert_eq!(boxes[1], Aabb::new([1.5, -0.5, 4.5], [2.5, 0.5, 5.5]));
//!
//! let (min, max) = ([[0.0; 3], [1.0; 3]], [[1.0; 3], [2.0; 3]]);
//! par_write_boxes(&MinMax::points(&min, &max), &mut boxes);
//! assert!(boxes[0].overlaps(&boxes[1]), "touching counts");
//! ```

mod columns;
mod sources;
mod stream;
mod way;

use rayon::prelude::*;

use crate::aabb::Aabb;
use crate::isa::AvailableIsa;
pub use sources::{CenterHalf, Columns, Layout, MinMax};
use stream::Stream;
use way::{Stores, Way};

/// Boxes that are made while they are written.
///
/// Frames and [`par_write_boxes`] take one. Packed boxes, [`MinMax`], [`CenterHalf`] and
/// [`Transformed`](crate::update::Transformed) are sources; implement it for a layout of your own.
pub trait BoxSource {
    /// Fewest boxes of a task: fewer take less time than a sleeping thread needs to begin.
    const TASK_BOXES: usize = way::COPIED_TASK_BOXES;

    /// Number of boxes.
    fn len(&self) -> usize;

    /// Whether there are no boxes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Writes the boxes of the indices from `first` on into `out`, as many as it holds.
    ///
    /// Runs on several threads at once, for different indices, and possibly into a buffer in
    /// between. Floats that are computed have to be independent of the thread's flags
    /// ([`floats::with_default`](crate::floats::with_default)).
    ///
    /// # Panics
    /// When there are fewer boxes.
    fn write_range(&self, first: usize, out: &mut [Aabb]);

    /// The boxes, where they lie packed in memory.
    fn as_boxes(&self) -> Option<&[Aabb]> {
        None
    }
}

impl BoxSource for [Aabb] {
    fn len(&self) -> usize {
        self.len()
    }

    fn write_range(&self, first: usize, out: &mut [Aabb]) {
        out.copy_from_slice(&self[first..][..out.len()]);
    }

    fn as_boxes(&self) -> Option<&[Aabb]> {
        Some(self)
    }
}

impl BoxSource for Vec<Aabb> {
    fn len(&self) -> usize {
        self.len()
    }

    fn write_range(&self, first: usize, out: &mut [Aabb]) {
        self.as_slice().write_range(first, out);
    }

    fn as_boxes(&self) -> Option<&[Aabb]> {
        Some(self)
    }
}

impl<const N: usize> BoxSource for [Aabb; N] {
    fn len(&self) -> usize {
        N
    }

    fn write_range(&self, first: usize, out: &mut [Aabb]) {
        self.as_slice().write_range(first, out);
    }

    fn as_boxes(&self) -> Option<&[Aabb]> {
        Some(self)
    }
}

/// Writes every box into `out`, on this thread.
///
/// # Panics
/// When `out` does not hold as many boxes as the source has.
pub fn write_boxes<S: BoxSource + ?Sized>(source: &S, out: &mut [Aabb]) {
    check_room(source, out);
    write_part(source, 0, out, Stores::of(out.len()), AvailableIsa::best());
}

/// Writes every box into `out`, large scenes on the calling thread's rayon pool.
///
/// # Panics
/// When `out` does not hold as many boxes as the source has.
pub fn par_write_boxes<S: BoxSource + Sync + ?Sized>(source: &S, out: &mut [Aabb]) {
    let way = Way::of::<S>(out.len(), rayon::current_num_threads());
    way.write(source, out, AvailableIsa::best());
}

impl Way {
    /// Writes every box into `out` in this way.
    fn write<S: BoxSource + Sync + ?Sized>(&self, source: &S, out: &mut [Aabb], isa: AvailableIsa) {
        check_room(source, out);
        let part_boxes = self.part_boxes.max(1);
        if out.len() <= part_boxes {
            return write_part(source, 0, out, self.stores, isa);
        }
        out.par_chunks_mut(part_boxes)
            .enumerate()
            .for_each(|(k, out)| write_part(source, k * part_boxes, out, self.stores, isa));
    }
}

fn check_room<S: BoxSource + ?Sized>(source: &S, out: &[Aabb]) {
    assert_eq!(source.len(), out.len(), "as many boxes as there is room for");
}

/// Boxes that are made in the first-level cache before they are streamed: twelve cache lines.
///
/// All lines of a frame that begins on a line are then written whole. Making boxes overlaps with
/// streaming those before, as long as both fit into the processor's queue of stores: with 64 or 128
/// boxes a frame takes 1.4 to 2.5 times as long on Zen 4. With fewer, calls cost more.
const STAGED_BOXES: usize = 32;

/// Writes the boxes from `first` on, on this thread.
fn write_part<S: BoxSource + ?Sized>(
    source: &S,
    first: usize,
    out: &mut [Aabb],
    stores: Stores,
    isa: AvailableIsa,
) {
    if stores == Stores::Cached {
        return source.write_range(first, out);
    }
    let end = first + out.len();
    let mut stream = Stream::new(out, isa);
    if let Some(boxes) = source.as_boxes() {
        return stream.put(&boxes[first..end]);
    }
    let mut staged = [Aabb::EMPTY; STAGED_BOXES];
    for at in (first..end).step_by(STAGED_BOXES) {
        let staged = &mut staged[..STAGED_BOXES.min(end - at)];
        source.write_range(at, staged);
        stream.put(staged);
    }
}

#[cfg(test)]
mod tests;
