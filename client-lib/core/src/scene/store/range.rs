//! Many boxes set at once, by a range of indices: in parts, side by side.

use super::{CHANGED, NAMED, OFF, PRESENT, Store, are_same};
use crate::aabb::Aabb;
use crate::engine::strips::{in_parts, part_count};

/// Fewest boxes of an edit that is applied so.
const BOXES_LEAST: usize = 8_192;
/// Boxes of a task, at least.
const TASK_BOXES: usize = 4_096;

/// Some indices of the range, and what is kept of them.
struct Part<'a> {
    first: u32,
    set: &'a [Aabb],
    boxes: &'a mut [Aabb],
    then: &'a mut [Aabb],
    flags: &'a mut [u8],
}

/// What a part has come across.
#[derive(Default)]
struct Noted {
    inserted: usize,
    any_differs: bool,
    /// Those that changed for the first time.
    changed: Vec<u32>,
    /// Those that are switched off, which stay so.
    parked: Vec<(u32, Aabb)>,
}

impl Noted {
    fn with(mut self, mut later: Self) -> Self {
        self.changed.append(&mut later.changed);
        self.parked.append(&mut later.parked);
        Self {
            inserted: self.inserted + later.inserted,
            any_differs: self.any_differs | later.any_differs,
            ..self
        }
    }
}

impl Store {
    /// Whether boxes of a range are better set by [`Self::set_range`].
    pub(super) const fn is_long(set: &[Aabb]) -> bool {
        set.len() >= BOXES_LEAST
    }

    /// Sets boxes from an index on. There is room for them, and nothing else is in the edit.
    pub(super) fn set_range(&mut self, first: u32, set: &[Aabb], threads: usize) {
        let range = first as usize..first as usize + set.len();
        let parts = part_count(set.len(), TASK_BOXES, threads);
        let step = set.len().div_ceil(parts).max(1);
        let firsts = (first..).step_by(step);
        let arrays = self.boxes[range.clone()]
            .chunks_mut(step)
            .zip(self.then[range.clone()].chunks_mut(step))
            .zip(self.flags[range].chunks_mut(step));
        let mut work: Vec<Part<'_>> = firsts
            .zip(set.chunks(step).zip(arrays))
            .map(|(first, (set, ((boxes, then), flags)))| Part { first, set, boxes, then, flags })
            .collect();
        let run = |work: &mut [Part<'_>]| {
            work.iter_mut().map(Part::run).fold(Noted::default(), Noted::with)
        };
        let mut noted = in_parts(work.as_mut_slice(), parts, &run, &Noted::with);
        self.present += noted.inserted;
        self.is_changed |= noted.any_differs;
        self.named.extend(first..first + set.len() as u32);
        if self.changed.is_empty() {
            self.changed = noted.changed;
        } else {
            self.changed.append(&mut noted.changed);
        }
        self.parked.extend(noted.parked);
    }
}

impl Part<'_> {
    fn run(&mut self) -> Noted {
        let mut noted = Noted { changed: Vec::with_capacity(self.set.len()), ..Noted::default() };
        let kept = self.boxes.iter_mut().zip(self.then.iter_mut()).zip(self.flags.iter_mut());
        for ((index, set), ((b, then), flags)) in (self.first..).zip(self.set).zip(kept) {
            noted.inserted += usize::from(*flags & PRESENT == 0);
            *flags |= PRESENT | NAMED;
            if *flags & OFF != 0 {
                noted.parked.push((index, *set));
                continue;
            }
            if are_same(b, set) {
                continue;
            }
            noted.any_differs = true;
            if *flags & CHANGED == 0 {
                *flags |= CHANGED;
                noted.changed.push(index);
                *then = *b;
            }
            *b = *set;
        }
        noted
    }
}
