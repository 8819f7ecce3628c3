//! The order of the boxes: cut by cut, until each 16 lie together.

use std::borrow::Cow;

use super::FAN_OUT;
use super::cut::{Cut, Surroundings};
use super::divide::divide;
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::engine::{AvailableIsa, Census};
use crate::floats;
use crate::team::{Split, in_parts, part_count};

/// Fewest boxes that are read, or arranged, by a task.
pub(super) const TASK_BOXES: usize = 4_096;

/// Boxes of a group beyond which what is around its sides is looked for anew: it takes as long as to part 500 boxes.
const LARGE: usize = 512;

/// Boxes of a group beyond which it is looked before it is parted whether anybody waits for the answer: smaller ones
/// take less than 100 µs.
const LOOKED_AT: usize = 2_048;

/// A box on its way into the order: 32 bytes, two to a cache line.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Entry {
    pub aabb: Aabb,
    pub index: u32,
    /// Not 0 for one that overlaps nothing.
    is_idle: u32,
}

/// Boxes, and the entries that they become.
struct Reading<'a> {
    boxes: &'a [Aabb],
    first_index: u32,
    entries: &'a mut [Entry],
}

impl Split for Reading<'_> {
    fn len(&self) -> usize {
        self.boxes.len()
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let (boxes, later_boxes) = self.boxes.split_at(at);
        let (entries, later_entries) = self.entries.split_at_mut(at);
        let first_index = self.first_index + at as u32;
        let later = Self { boxes: later_boxes, first_index, entries: later_entries };
        (Self { boxes, entries, ..self }, later)
    }
}

/// Copies the boxes, each once, and counts those that overlap nothing.
pub(super) fn read(boxes: &[Aabb], entries: &mut [Entry], threads: usize) -> Census {
    let work = Reading { boxes, first_index: 0, entries };
    let parts = part_count(boxes.len(), TASK_BOXES, threads);
    let run = |Reading { boxes, first_index, entries }: Reading<'_>| {
        let mut census = Census::default();
        for ((entry, aabb), index) in entries.iter_mut().zip(boxes).zip(first_index..) {
            let aabb = *aabb;
            let is_valid = census.note_box(index, &aabb);
            *entry = Entry { aabb, index, is_idle: u32::from(!is_valid) };
        }
        census
    };
    in_parts(work, parts, &run, &|low, high| low.then(&high))
}

/// Brings what overlaps nothing to the end; the other boxes.
pub(super) fn valid_first<'a>(entries: &'a mut [Entry], census: &Census) -> &'a mut [Entry] {
    let valid = census.valid_of(entries.len());
    if valid < entries.len() {
        let mut next = 0;
        for at in 0..entries.len() {
            if entries[at].is_idle == 0 {
                entries.swap(at, next);
                next += 1;
            }
        }
    }
    &mut entries[..valid]
}

/// Brings valid boxes into order, in so many parts, unless cancelled. Ranges that are whole groups of every size, from their
/// first box on, lie close together. `keys` has room for one a box.
pub(super) fn arrange(
    entries: &mut [Entry],
    keys: &mut [i32],
    around: &Surroundings,
    parts: usize,
    isa: AvailableIsa,
    cancel: &Cancel,
) {
    let (mut rest, mut keys) = (entries, keys);
    let mut around = Cow::Borrowed(around);
    while rest.len() > FAN_OUT {
        let all = rest.len();
        if all > LOOKED_AT && cancel.look() {
            return;
        }
        let granule = FAN_OUT.pow((all - 1).ilog(FAN_OUT));
        let (at, sides) = floats::with_default(|| {
            let cut = Cut::choose(rest, &around, isa);
            let groups = all.div_ceil(granule);
            let before = ((cut.share * groups as f32).round() as usize).clamp(1, groups - 1);
            let at = before * granule;
            divide(rest, keys, at, (cut.by, cut.mean), isa);
            (at, (all > LARGE).then(|| cut.surroundings((*rest).split_at(at), &around)))
        });
        let (low, high) = std::mem::take(&mut rest).split_at_mut(at);
        let (low_keys, high_keys) = std::mem::take(&mut keys).split_at_mut(at);
        let [of_low, of_high] = match &sides {
            Some([low, high]) => [low, high],
            None => [&*around; 2],
        };
        if parts > 1 {
            let low_parts = (parts * at / all).clamp(1, parts - 1);
            rayon::join(
                || arrange(low, low_keys, of_low, low_parts, isa, cancel),
                || arrange(high, high_keys, of_high, parts - low_parts, isa, cancel),
            );
            return;
        }
        arrange(low, low_keys, of_low, 1, isa, cancel);
        (rest, keys) = (high, high_keys);
        if let Some([_, of_high]) = sides {
            around = Cow::Owned(of_high);
        }
    }
}
