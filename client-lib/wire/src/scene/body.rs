//! The body of an edit: its steps as records, the indices that they name, and boxes.

use bytemuck::{Pod, Zeroable};
use pairmask_core::aabb::Aabb;
use pairmask_core::scene::{Edit, Indices, Sets, Step};
use pairmask_core::units::BoxCount;
use pairmask_core::write::par_write_boxes;

use super::request::{BOX_BYTES, SceneRequest};
use crate::page::Page;
use crate::pages::boxes_in;
use crate::reject::Reject;
use crate::section::{Section, SectionKind};

/// A step of an edit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct StepRecord {
    /// What it does: one of the constants below.
    does: u32,
    /// How it names indices: one of the constants below.
    names: u32,
    /// First index of a range or a bitmask.
    first: u32,
    /// Indices of a range, words of a list or a bitmask.
    count: u32,
    /// Where its words begin among the words of the edit.
    words_at: u32,
    /// Where its boxes begin among the boxes of the edit.
    boxes_at: u32,
}

/// Bytes of a step.
pub(super) const STEP_BYTES: u64 = 24;
const _: () = assert!(size_of::<StepRecord>() as u64 == STEP_BYTES);

const REMOVE: u32 = 1;
const SET: u32 = 2;
const SWITCH_ON: u32 = 3;
const SWITCH_OFF: u32 = 4;
const MAKE_STATIC: u32 = 5;
const MAKE_MOVABLE: u32 = 6;

const LIST: u32 = 1;
const RANGE: u32 = 2;
const MASK: u32 = 3;

/// Indices that one edit may name, in all its steps together, for each box that the scene may hold:
/// removed, set, switched and flagged, and as much again. More would be work without end for one request.
const NAMED_PER_BOX: u64 = 8;

/// Boxes and words begin on a cache line.
const LINE_BYTES: u64 = 64;

/// Where the parts of an edit lie in its payload.
#[derive(Clone, Debug)]
pub struct EditLayout {
    records: Vec<StepRecord>,
    boxes: u64,
    words: u64,
}

/// Rising indices of a list as words of a bitmask, where those are fewer.
fn as_mask(list: &[u32]) -> Option<(u32, usize)> {
    let (first, last) = (*list.first()?, *list.last()?);
    let words = (last.checked_sub(first)? / 32) as usize + 1;
    (words < list.len() && list.is_sorted_by(|a, b| a < b)).then_some((first, words))
}

impl EditLayout {
    /// The layout of an edit. `None` where a part of it is larger than 2^32 items, which no scene can hold.
    pub fn of(edit: Edit<'_>) -> Option<Self> {
        let mut layout = Self { records: Vec::with_capacity(edit.steps.len()), boxes: 0, words: 0 };
        for step in edit.steps {
            let (does, indices, boxes) = match *step {
                Step::Remove(indices) => (REMOVE, indices, 0),
                Step::Set(Sets { indices, boxes }) => (SET, indices, boxes.len() as u64),
                Step::Switch(indices, true) => (SWITCH_ON, indices, 0),
                Step::Switch(indices, false) => (SWITCH_OFF, indices, 0),
                Step::Static(indices, true) => (MAKE_STATIC, indices, 0),
                Step::Static(indices, false) => (MAKE_MOVABLE, indices, 0),
                // A step of a later core.
                _ => return None,
            };
            let (names, first, count) = match indices {
                Indices::Range { first, count } => (RANGE, first, count as usize),
                Indices::Mask { first, words } => (MASK, first, words.len()),
                Indices::List(list) => match as_mask(list) {
                    Some((first, words)) => (MASK, first, words),
                    None => (LIST, 0, list.len()),
                },
                _ => return None,
            };
            layout.records.push(StepRecord {
                does,
                names,
                first,
                count: u32::try_from(count).ok()?,
                words_at: u32::try_from(layout.words).ok()?,
                boxes_at: u32::try_from(layout.boxes).ok()?,
            });
            layout.boxes += boxes;
            layout.words += if names == RANGE { 0 } else { count as u64 };
        }
        Some(layout)
    }

    fn words_at(&self) -> u64 {
        (self.boxes * BOX_BYTES).next_multiple_of(LINE_BYTES)
    }

    fn records_at(&self) -> u64 {
        (self.words_at() + 4 * self.words).next_multiple_of(LINE_BYTES)
    }

    /// Bytes of the payload.
    pub fn payload_bytes(&self) -> u64 {
        self.records_at() + STEP_BYTES * self.records.len() as u64
    }

    /// The sections of boxes, steps and indices.
    pub fn sections(&self) -> [Section; 3] {
        let steps = STEP_BYTES * self.records.len() as u64;
        [
            Section::required(SectionKind::Boxes, 0, BOX_BYTES * self.boxes),
            Section::required(SectionKind::SceneSteps, self.records_at(), steps),
            Section::required(SectionKind::SceneIndices, self.words_at(), 4 * self.words),
        ]
    }

    /// Writes the edit that this is the layout of. Returns `false`, with part of it written, where the
    /// pages are too few.
    #[must_use]
    pub fn write(&self, edit: Edit<'_>, pages: &mut [Page]) -> bool {
        let all: &mut [u8] = bytemuck::cast_slice_mut(pages);
        // Boxes lie before everything else.
        let box_bytes = (BOX_BYTES * self.boxes) as usize;
        let words_at = self.words_at() as usize;
        if all.len() < words_at {
            return false;
        }
        let (boxes_mut, all) = all.split_at_mut(words_at);
        let boxes_mut: &mut [Aabb] = bytemuck::cast_slice_mut(&mut boxes_mut[..box_bytes]);
        let mut put = |offset: u64, bytes: &[u8]| {
            let place =
                all.get_mut(offset as usize - words_at..).and_then(|to| to.get_mut(..bytes.len()));
            place.map(|to| to.copy_from_slice(bytes)).is_some()
        };
        let mut is_written = put(self.records_at(), bytemuck::cast_slice(&self.records));
        let mut mask = Vec::new();
        for (step, record) in edit.steps.iter().zip(&self.records) {
            let indices = match step {
                Step::Set(Sets { indices, boxes }) => {
                    let (first, count) = (record.boxes_at as usize, boxes.len());
                    let place = boxes_mut.get_mut(first..).and_then(|to| to.get_mut(..count));
                    is_written &= place.map(|to| par_write_boxes(*boxes, to)).is_some();
                    indices
                }
                Step::Remove(indices) | Step::Switch(indices, _) | Step::Static(indices, _) => {
                    indices
                }
                _ => return false,
            };
            let words = match indices {
                Indices::List(list) if record.names == MASK => {
                    mask.clear();
                    mask.resize(record.count as usize, 0);
                    for index in *list {
                        let bit = index - record.first;
                        mask[bit as usize / 32] |= 1u32 << (bit % 32);
                    }
                    &mask
                }
                Indices::List(list) => *list,
                Indices::Mask { words, .. } => *words,
                _ => &[],
            };
            let offset = self.words_at() + 4 * u64::from(record.words_at);
            is_written &= put(offset, bytemuck::cast_slice(words));
        }
        is_written
    }
}

/// Memory for reading edits, kept from one to the next.
#[derive(Debug, Default)]
pub struct EditScratch {
    records: Vec<StepRecord>,
    words: Vec<u32>,
}

impl EditScratch {
    /// The steps of an edit. Records and indices are copied once, and checked; boxes stay where they
    /// lie, where their writer may still change them: each is to be read once.
    ///
    /// # Errors
    /// [`Reject::Edit`] where a step is malformed.
    pub fn read<'a>(
        &'a mut self,
        request: &SceneRequest,
        pages: &'a [Page],
    ) -> Result<Vec<Step<'a>>, Reject> {
        let wrong = |field| Reject::Edit { field };
        let all: &[u8] = bytemuck::cast_slice(pages);
        let bytes = |section: &Section| {
            let end = section.offset.checked_add(section.bytes)?;
            all.get(usize::try_from(section.offset).ok()?..usize::try_from(end).ok()?)
        };
        let records = bytes(&request.steps).ok_or(wrong("steps"))?;
        self.records.clear();
        self.records.resize(records.len() / size_of::<StepRecord>(), StepRecord::zeroed());
        bytemuck::cast_slice_mut(&mut self.records).copy_from_slice(records);
        let words = bytes(&request.indices).ok_or(wrong("indices"))?;
        self.words.clear();
        self.words.extend_from_slice(bytemuck::cast_slice(words));
        let count = u32::try_from(request.boxes.bytes / BOX_BYTES).map_err(|_| wrong("boxes"))?;
        let offset = usize::try_from(request.boxes.offset).map_err(|_| wrong("boxes"))?;
        let boxes = boxes_in(pages, offset, BoxCount::new(count)).ok_or(wrong("boxes"))?;

        let mut named = 0;
        let mut steps = Vec::with_capacity(self.records.len());
        for record in &self.records {
            let indices = indices_of(record, &self.words).ok_or(wrong("indices"))?;
            named += indices.len() as u64;
            if named > NAMED_PER_BOX * u64::from(request.most_boxes) {
                return Err(wrong("number of indices"));
            }
            steps.push(step_of(record, indices, boxes).ok_or(wrong("steps"))?);
        }
        Ok(steps)
    }
}

fn indices_of<'a>(record: &StepRecord, words: &'a [u32]) -> Option<Indices<'a>> {
    let own = || words.get(record.words_at as usize..)?.get(..record.count as usize);
    match record.names {
        LIST => Some(Indices::List(own()?)),
        RANGE => Some(Indices::Range { first: record.first, count: record.count }),
        MASK => Some(Indices::Mask { first: record.first, words: own()? }),
        _ => None,
    }
}

fn step_of<'a>(record: &StepRecord, indices: Indices<'a>, boxes: &'a [Aabb]) -> Option<Step<'a>> {
    match record.does {
        REMOVE => Some(Step::Remove(indices)),
        SET => {
            let own = boxes.get(record.boxes_at as usize..)?.get(..indices.len())?;
            Some(Step::Set(Sets { indices, boxes: own }))
        }
        SWITCH_ON => Some(Step::Switch(indices, true)),
        SWITCH_OFF => Some(Step::Switch(indices, false)),
        MAKE_STATIC => Some(Step::Static(indices, true)),
        MAKE_MOVABLE => Some(Step::Static(indices, false)),
        _ => None,
    }
}
