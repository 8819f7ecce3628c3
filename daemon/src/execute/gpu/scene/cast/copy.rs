//! The boxes of a scene in video memory, in host memory, for casts that the cores answer: a copy that follows edits. It is
//! read from there for the first such cast, and where none was made for some edits.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use pairmask_core::Aabb;
use pairmask_core::aabb::order_key;
use pairmask_core::cast::{Among, Limits};
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::states::{BoxStates, DISABLED, PRESENT, grow};
use pairmask_core::scene::{CastTree, Edit, Indices, Sets, Step};

use crate::execute::gpu::scene::memory::RECORD_BYTES;
use crate::execute::gpu::scene::replica::Replica;
use crate::execute::gpu::{Block, Command, Frame, GpuError, Home, Part};

/// Edits without a cast after which the copy is dropped: some seconds of a game.
const UNUSED_EDITS: u32 = 256;
/// Edits without a cast that the copy follows: to follow more would take longer than to read it when it is needed.
const FOLLOWED_EDITS: u32 = 8;

/// A record as it lies in video memory: keys of the mins and maxes, the history, and flags in the low byte.
pub(super) type Record = [i32; 8];
const _: () = assert!(size_of::<Record>() as u64 == RECORD_BYTES);

/// The copy that casts look at.
#[derive(Debug, Default)]
pub(super) struct CastCopy {
    /// Boxes by index, as they collide.
    boxes: Vec<Aabb>,
    /// Those that are disabled.
    disabled: HashMap<u32, Aabb>,
    /// Indices that the edit under way has changed.
    changed: Vec<u32>,
    tree: CastTree,
    is_current: bool,
    /// Since the last cast.
    edits: u32,
}

impl CastCopy {
    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>()
            + self.disabled.capacity() * (size_of::<(u32, Aabb)>() + 1)
            + self.changed.capacity() * size_of::<u32>()
            + self.tree.allocated_bytes()
    }

    /// Follows an edit that was applied, after which boxes have these states.
    pub fn note_edit(&mut self, edit: Edit<'_>, states: &BoxStates) {
        self.edits += 1;
        if self.edits > UNUSED_EDITS {
            *self = Self::default();
        }
        let is_followed = self.is_current && self.edits <= FOLLOWED_EDITS;
        self.is_current =
            is_followed && grow(&mut self.boxes, states.index_end(), Aabb::EMPTY).is_ok();
        if self.is_current {
            self.follow(edit, states);
        }
    }

    fn follow(&mut self, edit: Edit<'_>, states: &BoxStates) {
        let Self { boxes, disabled, changed, tree, .. } = self;
        changed.clear();
        edit.for_each_removed(|index| {
            disabled.remove(&index);
            boxes[index as usize] = Aabb::EMPTY;
            changed.push(index);
        });
        // Who set a box may have changed it since the GPU read it, and finds what it wrote.
        for Sets { indices, boxes: set } in edit.sets() {
            if let Indices::Range { first, count } = *indices {
                let start = if count == 0 { 0 } else { first as usize };
                boxes[start..][..set.len()].copy_from_slice(set);
                changed.extend(first..first + count);
            } else {
                indices.for_each(|at, index| {
                    boxes[index as usize] = set[at];
                    changed.push(index);
                });
            }
            if !disabled.is_empty() {
                indices.for_each(|_, index| {
                    disabled.remove(&index);
                });
            }
        }
        let mut settle = |index: u32| {
            let b = &mut boxes[index as usize];
            if !states.has(index, DISABLED) {
                if let Some(enabled) = disabled.remove(&index) {
                    *b = enabled;
                    changed.push(index);
                }
            } else if let Entry::Vacant(place) = disabled.entry(index) {
                place.insert(std::mem::replace(b, Aabb::EMPTY));
                changed.push(index);
            }
        };
        let has_disabled = states.active() < states.present();
        for step in edit.steps {
            match step {
                Step::Set(Sets { indices, .. }) if has_disabled => {
                    indices.for_each(|_, index| settle(index));
                }
                Step::Enable(indices, _) => indices.for_each(|_, index| settle(index)),
                _ => {}
            }
        }
        tree.note([&self.changed, &[]], self.boxes.len());
    }

    pub const fn is_current(&self) -> bool {
        self.is_current
    }

    /// All boxes, where the copy is current.
    pub fn boxes(&self) -> Option<&[Aabb]> {
        self.is_current.then_some(&self.boxes[..])
    }

    /// Where the cores look for so many shapes.
    pub fn among(&mut self, shapes: usize, limits: Limits<'_>) -> Among<'_> {
        self.edits = 0;
        self.tree.among(&self.boxes, shapes, limits.threads, limits.cancel)
    }

    /// Takes the boxes of all records.
    pub fn take(&mut self, records: &[Record]) -> Result<(), CullError> {
        let Self { boxes, disabled, tree, is_current, .. } = self;
        boxes.clear();
        disabled.clear();
        let needed_bytes = size_of_val(records) as u64;
        boxes.try_reserve(records.len()).map_err(|_| ReserveError::OutOfMemory { needed_bytes })?;
        boxes.extend((0..).zip(records).map(|(index, record)| {
            let b = box_of(record).unwrap_or(Aabb::EMPTY);
            if record[7] as u8 & DISABLED == 0 {
                return b;
            }
            disabled.insert(index, b);
            Aabb::EMPTY
        }));
        tree.note_all();
        *is_current = true;
        Ok(())
    }
}

/// The box of keys as they lie in a record. Of what overlaps nothing, and has keys of no number, this makes a NaN.
pub(super) fn box_of_keys(record: &Record) -> Aabb {
    Aabb::from(std::array::from_fn(|at| f32::from_bits(order_key(record[at] as u32) as u32)))
}

/// The box of a record, if it has one.
fn box_of(record: &Record) -> Option<Aabb> {
    (record[7] as u8 & PRESENT != 0).then(|| box_of_keys(record))
}

/// The box of a record as it collides.
pub(super) fn colliding(record: &Record) -> Aabb {
    let is_enabled = record[7] as u8 & DISABLED == 0;
    box_of(record).filter(|_| is_enabled).unwrap_or(Aabb::EMPTY)
}

/// All records, by index.
pub(super) fn read_records(replica: &Replica, slots: usize) -> Result<Vec<Record>, GpuError> {
    if slots == 0 {
        return Ok(Vec::new());
    }
    let bytes = slots as u64 * RECORD_BYTES;
    let gpu = replica.tools.gpu();
    let host = Block::new(gpu, Home::Host, bytes)?;
    let from = replica.memory.records_now().ok_or(GpuError::Lost)?;
    let copy = Command::Copy { from: Part::of(from, 0, bytes), to: Part::of(&host, 0, bytes) };
    Frame::run_once(gpu, vec![copy])?;
    let mut records = Vec::new();
    records.try_reserve_exact(slots).map_err(|_| GpuError::OutOfMemory { bytes })?;
    records.resize(slots, [0; 8]);
    host.read(0, &mut records);
    Ok(records)
}
