//! What an edit does, until it is sent: steps that name the caller's arrays, and boxes that were set one by one.

use std::ops::Range;

use super::edit::{FilterDataSets, Indices, Sets, Step, UserData, UserDataSets};
use super::error::EditError;
use super::margins::MarginedSets;
use crate::aabb::Aabb;
use crate::filters::FilterData;
use crate::precision::Margin;

/// What an edit sets one by one, or by a function; kept, so that steady edits allocate nothing.
#[derive(Debug, Default)]
pub struct Draft {
    /// Indices of boxes that are set one by one.
    pub indices: Vec<u32>,
    /// Their boxes.
    pub boxes: Vec<Aabb>,
    /// One for each, of a scene with margins.
    pub margins: Vec<Margin>,
    /// Boxes of [`Given::fills`].
    pub filled: Vec<Aabb>,
    /// Indices of boxes that are removed one by one.
    pub removed: Vec<u32>,
    /// Indices of boxes that are given filter data one by one.
    pub filtered: Vec<u32>,
    /// Their filter data.
    pub filter_data: Vec<FilterData>,
    /// Indices of boxes that are given user data one by one.
    pub marked: Vec<u32>,
    /// Their user data.
    pub user_data: Vec<UserData>,
}

/// What an edit does beside its [`Draft`].
#[derive(Debug, Default)]
pub struct Given<'a> {
    /// Steps that name the caller's arrays.
    pub steps: Vec<Step<'a>>,
    /// Indices, and where their boxes lie in the field `filled` of the [`Draft`].
    pub fills: Vec<(Indices<'a>, Range<usize>)>,
    /// Boxes with margins of their own, of a scene with margins.
    pub margined: Vec<MarginedSets<'a>>,
}

impl Draft {
    /// An empty one, with the memory of this.
    pub fn clear(&mut self) {
        self.indices.clear();
        self.boxes.clear();
        self.margins.clear();
        self.filled.clear();
        self.removed.clear();
        self.filtered.clear();
        self.filter_data.clear();
        self.marked.clear();
        self.user_data.clear();
    }

    fn singles(&self) -> Option<Sets<'_>> {
        let sets = || Sets { indices: Indices::List(&self.indices), boxes: &self.boxes };
        (!self.indices.is_empty()).then(sets)
    }

    /// What functions gave.
    fn filled<'a>(&'a self, given: &Given<'a>) -> impl Iterator<Item = Sets<'a>> {
        let sets = move |(indices, slot): &(Indices<'a>, Range<usize>)| Sets {
            indices: *indices,
            boxes: &self.filled[slot.clone()],
        };
        given.fills.iter().map(sets)
    }

    /// All steps of an edit.
    pub fn steps<'a>(&'a self, given: &Given<'a>) -> Vec<Step<'a>> {
        let mut steps = given.steps.clone();
        steps.extend(given.margined.iter().map(MarginedSets::step));
        steps.extend(self.filled(given).map(Step::Set));
        if !self.removed.is_empty() {
            steps.push(Step::Remove(Indices::List(&self.removed)));
        }
        steps.extend(self.singles().map(Step::Set));
        if !self.marked.is_empty() {
            steps.push(Step::UserData(UserDataSets {
                indices: Indices::List(&self.marked),
                user_data: &self.user_data,
            }));
        }
        if !self.filtered.is_empty() {
            steps.push(Step::FilterData(FilterDataSets {
                indices: Indices::List(&self.filtered),
                filter_data: &self.filter_data,
            }));
        }
        steps
    }

    /// All boxes that an edit sets, with their margins: `usual` ones, where none were given.
    pub fn margined<'a>(&'a self, given: &Given<'a>, usual: Margin) -> Vec<MarginedSets<'a>> {
        let of = |Sets { indices, boxes }, margins| MarginedSets { indices, boxes, margins };
        let mut all = given.margined.clone();
        let sets = given.steps.iter().filter_map(|step| match step {
            Step::Set(sets) => Some(*sets),
            _ => None,
        });
        all.extend(sets.chain(self.filled(given)).map(|sets| of(sets, usual.into())));
        all.extend(self.singles().map(|sets| of(sets, (&self.margins).into())));
        all
    }

    /// Keeps a box for each index, all of which are below a limit.
    ///
    /// # Errors
    /// [`EditError::BeyondLimit`], [`EditError::NoMemory`].
    pub fn fill(
        &mut self,
        indices: Indices<'_>,
        limit: u32,
        mut f: impl FnMut(u32) -> Aabb,
    ) -> Result<Range<usize>, EditError> {
        if let Some(index) = indices.last().filter(|last| *last >= u64::from(limit)) {
            return Err(EditError::BeyondLimit { index, limit });
        }
        let (start, count) = (self.filled.len(), indices.len());
        let no_memory = |_| EditError::NoMemory { boxes: count as u64 };
        self.filled.try_reserve(count).map_err(no_memory)?;
        indices.for_each(|_, index| self.filled.push(f(index)));
        Ok(start..self.filled.len())
    }
}
