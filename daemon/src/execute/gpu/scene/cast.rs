//! Casts into a scene in video memory: the cores answer them, from a copy of its boxes that follows edits. It is read from
//! there for the first cast, and where none was made for some edits.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use pairmask_core::Aabb;
use pairmask_core::aabb::order_key;
use pairmask_core::cast::Hit;
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::states::{BoxStates, DISABLED, PRESENT, STILL, grow};
use pairmask_core::scene::{Cast, CastTree, Edit, Indices, QueryError, Sets, Step};

use super::ENGINE;
use super::memory::RECORD_BYTES;
use super::replica::Replica;
use crate::execute::gpu::{Block, Command, Frame, GpuError, GpuScene, Home, Part};

/// Edits without a cast after which the copy is dropped: some seconds of a game.
const UNUSED_EDITS: u32 = 256;
/// Edits without a cast that the copy follows: to follow more would take longer than to read it when it is needed.
const FOLLOWED_EDITS: u32 = 8;

/// A record as it lies in video memory: keys of the mins and maxes, the history, and flags in the low byte.
type Record = [i32; 8];
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
}

/// The box of a record, if it has one.
fn box_of(record: &Record) -> Option<Aabb> {
    // Of what overlaps nothing, and has keys of no number, this makes a NaN.
    let of = |at: usize| f32::from_bits(order_key(record[at] as u32) as u32);
    (record[7] as u8 & PRESENT != 0).then(|| Aabb::from(std::array::from_fn(of)))
}

fn read_records(replica: &Replica, slots: usize) -> Result<Vec<Record>, GpuError> {
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

impl GpuScene {
    /// As [`Scene::cast`](pairmask_core::scene::Scene::cast).
    ///
    /// # Errors
    /// [`QueryError`]. After [`CullError::DeviceLost`] the scene is to be dropped.
    pub fn cast(&mut self, cast: &Cast<'_>, found: &mut Vec<Hit>) -> Result<u64, QueryError> {
        cast.filter_data.check(cast.shapes.len())?;
        if !self.casts.is_current {
            self.copy_boxes()?;
        }
        let threads = self.threads();
        let Self { casts: CastCopy { boxes, tree, edits, .. }, roster, .. } = self;
        *edits = 0;
        let among = tree.among(boxes, cast.shapes.len(), threads);
        let is_still = |index| roster.states.has(index, STILL);
        Ok(cast.among(among, &roster.states.filters, is_still, threads, found)?)
    }

    /// Reads all boxes from the first GPU that has them.
    fn copy_boxes(&mut self) -> Result<(), CullError> {
        let slots = self.roster.states.index_end();
        let records = loop {
            if slots == 0 {
                break Vec::new();
            }
            let replica = self.replicas.first();
            let read = read_records(replica, slots);
            match read.map_err(|error| replica.tools.gpu().cull_error(ENGINE, &error)) {
                Ok(records) => break records,
                Err(CullError::DeviceLost { .. }) if self.replicas.leave_first() => {}
                Err(error) => return Err(error),
            }
        };
        let CastCopy { boxes, disabled, tree, is_current, .. } = &mut self.casts;
        boxes.clear();
        disabled.clear();
        let needed_bytes = (slots * size_of::<Aabb>()) as u64;
        boxes.try_reserve(slots).map_err(|_| ReserveError::OutOfMemory { needed_bytes })?;
        boxes.extend((0..).zip(&records).map(|(index, record)| {
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
