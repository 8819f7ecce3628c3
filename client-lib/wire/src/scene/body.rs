//! The body of an edit: its steps as records, the indices that they name, and boxes.

use std::borrow::Cow;

use bytemuck::{Pod, Zeroable};
use pairmask_core::aabb::Aabb;
use pairmask_core::filters::{Filter, FilterTable};
use pairmask_core::scene::{Edit, FilterDataSets, Indices, Sets, Step, UserData, UserDataSets};
use pairmask_core::write::par_write_boxes;

use super::request::{BOX_BYTES, SceneRequest};
use crate::page::Page;
use crate::reject::Reject;
use crate::rules::entries::{
    FILTER_DATA_WORDS, FILTER_WORDS, NAMED_PER_BOX, PAIR_WORDS, filter_of, words_of,
};
use crate::section::{Section, SectionKind};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct StepRecord {
    /// What it does: one of the constants below.
    does: u32,
    /// How it names indices: one of the constants below; 0 where it names none.
    names: u32,
    /// First index of a range or a bitmask.
    first: u32,
    /// Indices of a range, words of a list or a bitmask; filters, or pairs.
    count: u32,
    /// Where its words begin among the words of the edit.
    words_at: u32,
    /// Where its boxes begin among the boxes of the edit, or its filter data among the words.
    entries_at: u32,
}

impl StepRecord {
    /// Words that name its indices.
    const fn words(&self) -> u64 {
        if matches!(self.names, LIST | MASK) { self.count as u64 } else { 0 }
    }

    /// Words of what it has beside its indices, of which there are so many: filter data, user data, filters or pairs.
    const fn entry_words(&self, indices: usize) -> u64 {
        match self.does {
            FILTER_DATUM => (FILTER_DATA_WORDS * indices) as u64,
            USER_DATA => (USER_DATA_WORDS * indices) as u64,
            FILTERS => FILTER_WORDS as u64 * self.count as u64,
            INCLUDE | INCLUDE_NO_MORE | EXCLUDE | EXCLUDE_NO_MORE => {
                PAIR_WORDS as u64 * self.count as u64
            }
            _ => 0,
        }
    }
}

pub(super) const STEP_BYTES: u64 = 24;
const _: () = assert!(size_of::<StepRecord>() as u64 == STEP_BYTES);

const REMOVE: u32 = 1;
const SET: u32 = 2;
const ENABLE: u32 = 3;
const DISABLE: u32 = 4;
const MAKE_STATIC: u32 = 5;
const MAKE_MOVABLE: u32 = 6;
const FILTER_DATUM: u32 = 7;
const FILTERS: u32 = 8;
const INCLUDE: u32 = 9;
const INCLUDE_NO_MORE: u32 = 10;
const EXCLUDE: u32 = 11;
const EXCLUDE_NO_MORE: u32 = 12;
const USER_DATA: u32 = 13;

const USER_DATA_WORDS: usize = size_of::<UserData>() / size_of::<u32>();

const LIST: u32 = 1;
const RANGE: u32 = 2;
const MASK: u32 = 3;

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
            let Written { does, indices, boxes, entries, count } = Written::of(step)?;
            let (names, first, count) = match indices {
                None => (0, 0, count),
                Some(Indices::Range { first, count }) => (RANGE, first, count as usize),
                Some(Indices::Mask { first, words }) => (MASK, first, words.len()),
                Some(Indices::List(list)) => as_mask(list)
                    .map_or((LIST, 0, list.len()), |(first, words)| (MASK, first, words)),
                Some(_) => return None,
            };
            let words = if matches!(names, LIST | MASK) { count as u64 } else { 0 };
            let entries_at = if entries.is_some() { layout.words + words } else { layout.boxes };
            layout.records.push(StepRecord {
                does,
                names,
                first,
                count: u32::try_from(count).ok()?,
                words_at: u32::try_from(layout.words).ok()?,
                entries_at: u32::try_from(entries_at).ok()?,
            });
            layout.boxes += boxes.len() as u64;
            layout.words += words + entries.map_or(0, |entries| entries.len() as u64);
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
        let [boxes_at, records_at, words_at] = self.sections();
        let mut is_written = records_at.put(bytemuck::cast_slice(&self.records), pages, false);
        let mut mask = Vec::new();
        for (step, record) in edit.steps.iter().zip(&self.records) {
            let Some(Written { indices, boxes, entries, .. }) = Written::of(step) else {
                return false;
            };
            let put = |at: u32, words: &[u32], pages: &mut [Page]| {
                let slot = Section { offset: words_at.offset + 4 * u64::from(at), ..words_at };
                slot.put(bytemuck::cast_slice(words), pages, false)
            };
            is_written &= if let Some(entries) = entries {
                put(record.entries_at, &entries, pages)
            } else {
                let (first, count) = (record.entries_at as usize, boxes.len());
                let slot =
                    boxes_at.entries_in_mut::<Aabb>(pages).and_then(|to| to.get_mut(first..));
                let slot = slot.and_then(|to| to.get_mut(..count));
                slot.map(|to| par_write_boxes(boxes, to)).is_some()
            };
            let words = match indices {
                Some(Indices::List(list)) if record.names == MASK => {
                    mask.clear();
                    mask.resize(record.count as usize, 0);
                    for index in list {
                        let bit = index - record.first;
                        mask[bit as usize / 32] |= 1u32 << (bit % 32);
                    }
                    &mask
                }
                Some(Indices::List(list)) => list,
                Some(Indices::Mask { words, .. }) => words,
                _ => &[],
            };
            is_written &= put(record.words_at, words, pages);
        }
        is_written
    }
}

/// A step as it is written.
struct Written<'a> {
    does: u32,
    /// `None` where it names none, but has so many items of its own.
    indices: Option<Indices<'a>>,
    boxes: &'a [Aabb],
    /// Its filter data, user data, filters or pairs as words.
    entries: Option<Cow<'a, [u32]>>,
    count: usize,
}

impl<'a> Written<'a> {
    /// `None` for a step of a later core.
    fn of(step: &Step<'a>) -> Option<Self> {
        let plain = |does, indices| Self {
            does,
            indices: Some(indices),
            boxes: &[],
            entries: None,
            count: 0,
        };
        let own = |does, entries: Cow<'a, [u32]>, count| Self {
            does,
            indices: None,
            boxes: &[],
            entries: Some(entries),
            count,
        };
        let pairs =
            |does, pairs: &'a [[u32; 2]]| own(does, pairs.as_flattened().into(), pairs.len());
        Some(match *step {
            Step::Remove(indices) => plain(REMOVE, indices),
            Step::Set(Sets { indices, boxes }) => Self { boxes, ..plain(SET, indices) },
            Step::Enable(indices, true) => plain(ENABLE, indices),
            Step::Enable(indices, false) => plain(DISABLE, indices),
            Step::Static(indices, true) => plain(MAKE_STATIC, indices),
            Step::Static(indices, false) => plain(MAKE_MOVABLE, indices),
            Step::FilterData(FilterDataSets { indices, filter_data }) => {
                let filter_data: &[u32] = bytemuck::cast_slice(filter_data);
                Self { entries: Some(filter_data.into()), ..plain(FILTER_DATUM, indices) }
            }
            Step::UserData(UserDataSets { indices, user_data }) => {
                let user_data: &[u32] = bytemuck::cast_slice(user_data);
                Self { entries: Some(user_data.into()), ..plain(USER_DATA, indices) }
            }
            Step::Filters(table) => {
                let words: Vec<u32> = table.filters().iter().flat_map(words_of).collect();
                own(FILTERS, words.into(), table.filters().len())
            }
            Step::Include(list, true) => pairs(INCLUDE, list),
            Step::Include(list, false) => pairs(INCLUDE_NO_MORE, list),
            Step::Exclude(list, true) => pairs(EXCLUDE, list),
            Step::Exclude(list, false) => pairs(EXCLUDE_NO_MORE, list),
            _ => return None,
        })
    }
}

/// Memory for reading edits, kept from one to the next.
#[derive(Debug, Default)]
pub struct EditScratch {
    records: Vec<StepRecord>,
    words: Vec<u32>,
    table: FilterTable,
    /// Boxes of an edit that was [copied](Self::copy).
    boxes: Vec<Aabb>,
    /// Indices of its scene are below this.
    most_boxes: u32,
}

impl EditScratch {
    /// The steps of an edit. Records and indices are copied once, and checked; boxes stay where they
    /// lie, where their writer may still change them: who reads one again, as each GPU of a scene does, may find
    /// another one there.
    ///
    /// # Errors
    /// [`Reject::Edit`] where a step is malformed.
    pub fn read<'a>(
        &'a mut self,
        request: &SceneRequest,
        pages: &'a [Page],
    ) -> Result<Vec<Step<'a>>, Reject> {
        self.copy_steps(request, pages)?;
        self.steps_of(request.boxes.entries_in(pages).ok_or(Reject::Edit("boxes"))?)
    }

    /// Copies an edit, its boxes as well, and checks it. Its [steps](Self::steps) are the same from then on,
    /// regardless of what becomes of the memory where it lay.
    ///
    /// # Errors
    /// As [`read`](Self::read); what is kept is of no use then.
    pub fn copy(&mut self, request: &SceneRequest, pages: &[Page]) -> Result<(), Reject> {
        self.copy_steps(request, pages)?;
        self.boxes.clear();
        let boxes = request.boxes.entries_in(pages).ok_or(Reject::Edit("boxes"))?;
        self.boxes.extend_from_slice(boxes);
        self.steps().map(drop)
    }

    /// The steps of the edit that was [copied](Self::copy) last.
    ///
    /// # Errors
    /// As that had.
    pub fn steps(&self) -> Result<Vec<Step<'_>>, Reject> {
        self.steps_of(&self.boxes)
    }

    /// Whether the last edit has no steps.
    pub const fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Whether the last edit gives the table of filters.
    pub fn has_table(&self) -> bool {
        self.records.iter().any(|record| record.does == FILTERS)
    }

    /// Bytes that are kept.
    pub fn allocated_bytes(&self) -> usize {
        self.records.capacity() * size_of::<StepRecord>()
            + self.words.capacity() * size_of::<u32>()
            + self.boxes.capacity() * size_of::<Aabb>()
            + self.table.allocated_bytes()
    }

    /// Copies what an edit says, but for boxes.
    fn copy_steps(&mut self, request: &SceneRequest, pages: &[Page]) -> Result<(), Reject> {
        self.most_boxes = request.most_boxes;
        let records = request.steps.entries_in(pages).ok_or(Reject::Edit("steps"))?;
        self.records.clear();
        self.records.extend_from_slice(records);
        let words = request.indices.entries_in(pages).ok_or(Reject::Edit("indices"))?;
        self.words.clear();
        self.words.extend_from_slice(words);

        let wrong = Reject::Edit("filters");
        let mut tables = self.records.iter().filter(|record| record.does == FILTERS);
        if let Some(record) = tables.next() {
            let words =
                entries_of::<[u32; FILTER_WORDS]>(record, record.count as usize, &self.words)
                    .ok_or(wrong)?;
            let filters: Vec<Filter> = words.iter().map(filter_of).collect();
            self.table = FilterTable::new(&filters).map_err(|_| wrong)?;
        }
        if tables.next().is_some() { Err(wrong) } else { Ok(()) }
    }

    /// The steps of the edit that was copied, over its boxes.
    fn steps_of<'a>(&'a self, boxes: &'a [Aabb]) -> Result<Vec<Step<'a>>, Reject> {
        let (mut named, mut words, mut set) = (0, 0, 0);
        let mut steps = Vec::with_capacity(self.records.len());
        for record in &self.records {
            // Steps share nothing. If they could, a record would make all words of an edit work once more.
            words += record.words();
            if words > self.words.len() as u64 {
                return Err(Reject::Edit("indices"));
            }
            let indices = indices_of(record, &self.words).ok_or(Reject::Edit("indices"))?;
            named += indices.len() as u64;
            if named > NAMED_PER_BOX * u64::from(self.most_boxes) {
                return Err(Reject::Edit("number of indices"));
            }
            words += record.entry_words(indices.len());
            set += if record.does == SET { indices.len() } else { 0 };
            if words > self.words.len() as u64 || set > boxes.len() {
                return Err(Reject::Edit("steps"));
            }
            steps.push(self.step(record, indices, boxes).ok_or(Reject::Edit("steps"))?);
        }
        Ok(steps)
    }

    fn step<'a>(
        &'a self,
        record: &StepRecord,
        indices: Indices<'a>,
        boxes: &'a [Aabb],
    ) -> Option<Step<'a>> {
        let pairs = || entries_of::<[u32; PAIR_WORDS]>(record, record.count as usize, &self.words);
        Some(match record.does {
            REMOVE => Step::Remove(indices),
            SET => {
                let own = boxes.get(record.entries_at as usize..)?.get(..indices.len())?;
                Step::Set(Sets { indices, boxes: own })
            }
            ENABLE => Step::Enable(indices, true),
            DISABLE => Step::Enable(indices, false),
            MAKE_STATIC => Step::Static(indices, true),
            MAKE_MOVABLE => Step::Static(indices, false),
            FILTER_DATUM => Step::FilterData(FilterDataSets {
                indices,
                filter_data: entries_of(record, indices.len(), &self.words)?,
            }),
            USER_DATA => Step::UserData(UserDataSets {
                indices,
                user_data: entries_of(record, indices.len(), &self.words)?,
            }),
            FILTERS => Step::Filters(&self.table),
            INCLUDE => Step::Include(pairs()?, true),
            INCLUDE_NO_MORE => Step::Include(pairs()?, false),
            EXCLUDE => Step::Exclude(pairs()?, true),
            EXCLUDE_NO_MORE => Step::Exclude(pairs()?, false),
            _ => return None,
        })
    }
}

/// The indices of a step: none where it is about none.
fn indices_of<'a>(record: &StepRecord, words: &'a [u32]) -> Option<Indices<'a>> {
    let own = || words.get(record.words_at as usize..)?.get(..record.count as usize);
    match (record.does, record.names) {
        (FILTERS | INCLUDE | INCLUDE_NO_MORE | EXCLUDE | EXCLUDE_NO_MORE, 0) => {
            Some(Indices::List(&[]))
        }
        (_, LIST) => Some(Indices::List(own()?)),
        (_, RANGE) => Some(Indices::Range { first: record.first, count: record.count }),
        (_, MASK) => Some(Indices::Mask { first: record.first, words: own()? }),
        _ => None,
    }
}

/// So many items of a step, of words that begin where it says.
fn entries_of<'a, T: Pod>(record: &StepRecord, count: usize, words: &'a [u32]) -> Option<&'a [T]> {
    let len = count.checked_mul(size_of::<T>() / size_of::<u32>())?;
    Some(bytemuck::cast_slice(words.get(record.entries_at as usize..)?.get(..len)?))
}
