//! Casts into a scene in video memory: the cores answer them, from a copy of its boxes that is read after each edit.

use pairmask_core::Aabb;
use pairmask_core::aabb::order_key;
use pairmask_core::cast::Hit;
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::states::{DISABLED, PRESENT, STILL};
use pairmask_core::scene::{Cast, CastTree, QueryError};

use super::ENGINE;
use super::memory::RECORD_BYTES;
use super::replica::Replica;
use crate::execute::gpu::{Block, Command, Frame, GpuError, GpuScene, Home, Part};

/// Edits without a cast after which the copy is dropped: some seconds of a game.
const UNUSED_EDITS: u32 = 256;

/// A record as it lies in video memory: keys of the mins and maxes, the history, and flags in the low byte.
type Record = [i32; 8];
const _: () = assert!(size_of::<Record>() as u64 == RECORD_BYTES);

/// The copy that casts look at.
#[derive(Debug, Default)]
pub(super) struct CastCopy {
    /// Boxes by index, as they collide.
    boxes: Vec<Aabb>,
    tree: CastTree,
    is_current: bool,
    /// Since the last cast.
    edits: u32,
}

impl CastCopy {
    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>() + self.tree.allocated_bytes()
    }

    /// Notes an edit.
    pub fn note_edit(&mut self) {
        self.is_current = false;
        self.edits += 1;
        if self.edits > UNUSED_EDITS {
            *self = Self::default();
        }
    }
}

/// What collides of a record.
fn colliding(record: &Record) -> Aabb {
    let flags = record[7] as u8;
    if flags & (PRESENT | DISABLED) != PRESENT {
        return Aabb::EMPTY;
    }
    // Of what overlaps nothing, and has keys of no number, this makes a NaN.
    Aabb::from(std::array::from_fn(|at| f32::from_bits(order_key(record[at] as u32) as u32)))
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
        let CastCopy { boxes, tree, is_current, .. } = &mut self.casts;
        boxes.clear();
        let needed_bytes = (slots * size_of::<Aabb>()) as u64;
        boxes.try_reserve(slots).map_err(|_| ReserveError::OutOfMemory { needed_bytes })?;
        boxes.extend(records.iter().map(colliding));
        tree.note_all();
        *is_current = true;
        Ok(())
    }
}
