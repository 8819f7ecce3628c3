//! The states of a scene's boxes by the client's indices, as they are and as they were when the history began:
//! box, enabled, static, filter data, and whether the index has had another box.

mod range;

use std::collections::HashMap;

use super::check::{EDIT_SETS, PRESENT, len_after, mark};
use super::edit::{Edit, Flag, Indices, Sets, Step};
use super::error::EditError;
use super::fetch::ask_for;
use super::huge_pages;
use super::rules::{FilterHistory, FilteredBoxes};
use crate::aabb::Aabb;
use crate::filters::Tag;

const OFF: u8 = 1 << 1;
/// It is [still](super::rules): static, as far as searches may skip pairs of two such boxes.
const STATIC: u8 = 1 << 2;
/// A box of this index was removed since the history began.
const REMOVED: u8 = 1 << 3;
/// Listed among the boxes that the edit under way names.
const NAMED: u8 = 1 << 6;
/// Changed since the history began.
const CHANGED: u8 = 1 << 7;
/// Sets in a list up to which their boxes are asked for before the first is made: they stay in a core's
/// caches until then.
const ASKED_MOST: usize = 8_192;

/// Whether a box is static and switched on.
const fn is_active_static(flags: u8) -> bool {
    flags & (STATIC | OFF) == STATIC
}

/// Whether two boxes are the same, bit by bit: floats would call a NaN changed each time, and −0
/// unchanged, by flags.
#[inline(always)]
pub(super) fn are_same(a: &Aabb, b: &Aabb) -> bool {
    let [a, b]: [[u32; 6]; 2] = [bytemuck::cast(*a), bytemuck::cast(*b)];
    (0..6).fold(0, |differ, i| differ | (a[i] ^ b[i])) == 0
}

/// What collides, or collided, at an index.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoxState {
    pub b: Aabb,
    pub is_static: bool,
}

/// Boxes and flags of a scene, by index.
#[derive(Debug, Default)]
pub(super) struct Store {
    /// What collides: [`Aabb::EMPTY`] for an index without a box, or whose box is switched off.
    boxes: Vec<Aabb>,
    flags: Vec<u8>,
    /// What collided when the history began, at indices that have changed since.
    then: Vec<Aabb>,
    /// Which of those are static now and were not, or the other way round; one bit each, for all indices or
    /// for none.
    toggled: Vec<u64>,
    /// Whose filter data have changed since the history began; one bit each, for all indices or for none.
    refiltered: Vec<u64>,
    filters: FilterHistory,
    /// Boxes that are switched off.
    parked: HashMap<u32, Aabb>,
    present: usize,
    statics: usize,
    /// Indices that lost a box since the history began.
    removed: Vec<u32>,
    /// Indices that the last edit set, switched or flagged.
    named: Vec<u32>,
    /// Indices that the last edit removed and did not set anew.
    gone: Vec<u32>,
    /// Whether the last edit changed anything.
    is_changed: bool,
    /// Indices whose box or static flag has changed since the history began, or that lost a box.
    changed: Vec<u32>,
}

impl Store {
    /// Boxes by index, as they collide.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Indices with a box.
    pub const fn present(&self) -> usize {
        self.present
    }

    /// Static boxes that are switched on.
    pub const fn statics(&self) -> usize {
        self.statics
    }

    /// Boxes that are switched off.
    pub fn parked(&self) -> usize {
        self.parked.len()
    }

    /// The box of an index, also one that is switched off.
    #[inline]
    pub fn get(&self, index: u32) -> Option<Aabb> {
        let i = index as usize;
        let has = self.flags.get(i).is_some_and(|flags| flags & PRESENT != 0);
        has.then(|| self.parked.get(&index).copied().unwrap_or(self.boxes[i]))
    }

    #[inline]
    pub const fn filters(&self) -> &FilterHistory {
        &self.filters
    }

    /// The filter data of a box, with its own static flag.
    pub fn tag(&self, index: u32) -> Tag {
        self.filters.tag(index, self.is_static(index))
    }

    /// Whether two boxes may be a pair, wherever they are.
    #[inline]
    pub fn may_meet(&self, pair: [u32; 2]) -> bool {
        !pair.iter().all(|index| self.is_static(*index)) && self.filters.meet(pair)
    }

    /// Whether filter data of a box have changed since the history began.
    #[inline]
    pub fn is_refiltered(&self, index: u32) -> bool {
        self.refiltered.get(index as usize / 64).is_some_and(|bits| bits >> (index % 64) & 1 == 1)
    }

    /// Whether the box of an index is [still](super::rules).
    #[inline]
    pub fn is_static(&self, index: u32) -> bool {
        self.flags[index as usize] & STATIC != 0
    }

    /// Whether the box of an index is switched off.
    #[inline]
    pub fn is_off(&self, index: u32) -> bool {
        self.flags[index as usize] & OFF != 0
    }

    /// Whether an index has a box that is switched on.
    #[inline]
    pub fn is_active(&self, index: u32) -> bool {
        self.flags[index as usize] & (PRESENT | OFF) == PRESENT
    }

    /// Whether the index lost a box since the history began.
    #[inline]
    pub fn was_removed(&self, index: u32) -> bool {
        self.flags[index as usize] & REMOVED != 0
    }

    /// Whether any index did.
    pub const fn has_removed(&self) -> bool {
        !self.removed.is_empty()
    }

    /// Whether the last edit changed anything.
    pub const fn is_changed(&self) -> bool {
        self.is_changed
    }

    /// Indices that have changed since the history began, in the order in which they first did.
    pub fn changed(&self) -> &[u32] {
        &self.changed
    }

    /// Whether an index has changed since the history began.
    #[inline]
    pub fn has_changed(&self, index: u32) -> bool {
        self.flags[index as usize] & CHANGED != 0
    }

    #[inline]
    pub fn now(&self, index: u32) -> BoxState {
        BoxState { b: self.boxes[index as usize], is_static: self.is_static(index) }
    }

    /// What collided at an index when the history began, if that has changed.
    #[inline]
    pub fn before(&self, index: u32) -> Option<BoxState> {
        let flags = self.flags[index as usize];
        let was_static = || (flags & STATIC != 0) != self.is_toggled(index);
        let was = || BoxState { b: self.then[index as usize], is_static: was_static() };
        (flags & CHANGED != 0).then(was)
    }

    /// Whether a box has become static, or no more static, since it first changed.
    #[inline]
    fn is_toggled(&self, index: u32) -> bool {
        self.toggled.get(index as usize / 64).is_some_and(|bits| bits >> (index % 64) & 1 == 1)
    }

    /// Notes that a box that has changed becomes static, or no more static.
    fn toggle(&mut self, index: u32) {
        let words = self.flags.len().div_ceil(64);
        self.toggled.resize(words.max(self.toggled.len()), 0);
        self.toggled[index as usize / 64] ^= 1 << (index % 64);
    }

    /// Asks for the boxes that an edit sets.
    fn ask_ahead(&self, edit: Edit<'_>) {
        for step in edit.steps {
            if let Step::Set(Sets { indices: Indices::List(list), .. }) = step
                && list.len() <= ASKED_MOST
            {
                list.iter().copied().for_each(|index| self.ask_for(index));
            }
        }
    }

    #[inline]
    pub fn ask_for(&self, index: u32) {
        self.ask_for_box(index);
        ask_for(&self.then, index);
        ask_for(&self.then, index + 1);
        ask_for(&self.flags, index);
    }

    /// Asks for the box of an index. One in three lies on two lines: the second one is that on which the
    /// next box begins.
    #[inline]
    pub fn ask_for_box(&self, index: u32) {
        ask_for(&self.boxes, index);
        ask_for(&self.boxes, index + 1);
    }

    /// Boxes as they collided when the history began, and which of them were static.
    pub fn then(&self) -> (Vec<Aabb>, Vec<bool>) {
        let mut boxes = self.boxes.clone();
        let mut statics: Vec<bool> = self.flags.iter().map(|flags| flags & STATIC != 0).collect();
        for &index in &self.changed {
            if let Some(before) = self.before(index) {
                boxes[index as usize] = before.b;
                statics[index as usize] = before.is_static;
            }
        }
        (boxes, statics)
    }

    /// Indices that the last edit removed.
    pub fn gone(&self) -> &[u32] {
        &self.gone
    }

    /// Indices that the last edit set, switched or flagged.
    pub fn named(&self) -> &[u32] {
        &self.named
    }

    /// Whether the last edit named an index.
    #[inline]
    pub fn is_named(&self, index: u32) -> bool {
        self.flags[index as usize] & NAMED != 0
    }

    pub fn allocated_bytes(&self) -> usize {
        let lists = self.removed.capacity()
            + self.named.capacity()
            + self.changed.capacity()
            + self.gone.capacity();
        (self.boxes.capacity() + self.then.capacity()) * size_of::<Aabb>()
            + self.flags.capacity()
            + (self.toggled.capacity() + self.refiltered.capacity()) * size_of::<u64>()
            + self.filters.allocated_bytes()
            + lists * size_of::<u32>()
            + self.parked.capacity() * (size_of::<(u32, Aabb)>() + 1)
    }

    /// The history begins anew.
    pub fn forget(&mut self) {
        for index in self.removed.drain(..) {
            self.flags[index as usize] &= !REMOVED;
        }
        for index in self.changed.drain(..) {
            self.flags[index as usize] &= !CHANGED;
        }
        self.toggled.clear();
        self.refiltered.clear();
        self.filters.forget();
        // Indices at the end without boxes cost every pass over all indices.
        if self.flags.len() > 1024 && self.present < self.flags.len() / 4 {
            self.forget_edit();
            let last = self.flags.iter().rposition(|flags| flags & PRESENT != 0);
            let len = last.map_or(0, |last| last + 1);
            if len < self.flags.len() / 2 {
                self.boxes.truncate(len);
                self.flags.truncate(len);
                self.then.truncate(len);
                self.boxes.shrink_to_fit();
                self.flags.shrink_to_fit();
                self.then.shrink_to_fit();
            }
        }
    }

    fn forget_edit(&mut self) {
        for index in self.named.drain(..) {
            self.flags[index as usize] &= !NAMED;
        }
        self.gone.clear();
        self.is_changed = false;
    }

    /// Checks an edit, and applies it if it is right. `limit` is the most boxes that the scene holds.
    ///
    /// # Errors
    /// [`EditError`]; nothing is applied then.
    pub fn apply(&mut self, edit: Edit<'_>, limit: u32, threads: usize) -> Result<(), EditError> {
        self.forget_edit();
        self.make_room(edit, limit)?;
        // Ranges name no index twice, so there is nothing else to check.
        if !edit.is_of_ranges() {
            mark(edit, &mut self.flags)?;
            self.ask_ahead(edit);
        }
        let mut filters = std::mem::take(&mut self.filters);
        edit.for_each_removed(|index| {
            self.remove(index);
            filters.remove(index);
        });
        self.set_all(edit, threads);
        edit.for_each_flag(|index, flag| match flag {
            Flag::On(on) => self.switch(index, on),
            Flag::Static(on) => filters.make_static(index, on, self),
        });
        filters.apply(edit, self);
        self.filters = filters;
        Ok(())
    }

    /// Sets the boxes of an edit that was checked.
    fn set_all(&mut self, edit: Edit<'_>, threads: usize) {
        for Sets { indices, boxes } in edit.sets() {
            match *indices {
                Indices::Range { first, .. } if Self::is_long(boxes) => {
                    self.set_range(first, boxes, threads);
                }
                indices => indices.for_each(|at, index| self.set(index, &boxes[at])),
            }
        }
    }

    /// Room for every index that is set, and the checks that need no marks.
    fn make_room(&mut self, edit: Edit<'_>, limit: u32) -> Result<(), EditError> {
        let len = len_after(edit, self.flags.len(), limit)?;
        let more = len - self.flags.len();
        let no_memory = |_| EditError::NoMemory { boxes: len as u64 };
        self.boxes.try_reserve(more).map_err(no_memory)?;
        self.flags.try_reserve(more).map_err(no_memory)?;
        self.then.try_reserve(more).map_err(no_memory)?;
        huge_pages::prefer(&self.boxes);
        self.boxes.resize(len, Aabb::EMPTY);
        self.flags.resize(len, 0);
        self.then.resize(len, Aabb::EMPTY);
        Ok(())
    }

    #[inline]
    fn note_named(&mut self, index: u32) {
        let flags = &mut self.flags[index as usize];
        if *flags & NAMED == 0 {
            *flags |= NAMED;
            self.named.push(index);
        }
    }

    /// Notes an index that is about to change.
    #[inline]
    fn note_changed(&mut self, index: u32) {
        self.is_changed = true;
        let flags = &mut self.flags[index as usize];
        if *flags & CHANGED == 0 {
            *flags |= CHANGED;
            self.changed.push(index);
            self.then[index as usize] = self.boxes[index as usize];
        }
    }

    fn remove(&mut self, index: u32) {
        self.note_changed(index);
        self.gone.push(index);
        let flags = &mut self.flags[index as usize];
        if *flags & REMOVED == 0 {
            self.removed.push(index);
        }
        self.present -= 1;
        self.statics -= usize::from(is_active_static(*flags));
        if *flags & OFF != 0 {
            self.parked.remove(&index);
        }
        let was_static = *flags & STATIC != 0;
        *flags = *flags & (CHANGED | NAMED) | REMOVED;
        self.boxes[index as usize] = Aabb::EMPTY;
        if was_static {
            self.toggle(index);
        }
    }

    #[inline]
    fn set(&mut self, index: u32, b: &Aabb) {
        let i = index as usize;
        let flags = &mut self.flags[i];
        *flags &= !EDIT_SETS;
        if *flags & PRESENT == 0 {
            *flags |= PRESENT;
            self.present += 1;
        }
        self.note_named(index);
        if self.flags[i] & OFF != 0 {
            self.parked.insert(index, *b);
        } else {
            self.place(index, *b);
        }
    }

    /// Puts what collides at an index.
    #[inline]
    fn place(&mut self, index: u32, b: Aabb) {
        if !are_same(&self.boxes[index as usize], &b) {
            self.note_changed(index);
            self.boxes[index as usize] = b;
        }
    }

    fn switch(&mut self, index: u32, on: bool) {
        self.note_named(index);
        let i = index as usize;
        let is_on = self.flags[i] & OFF == 0;
        self.statics -= usize::from(is_active_static(self.flags[i]));
        if is_on && !on {
            self.flags[i] |= OFF;
            self.parked.insert(index, self.boxes[i]);
            self.place(index, Aabb::EMPTY);
        } else if !is_on && on {
            self.flags[i] &= !OFF;
            if let Some(b) = self.parked.remove(&index) {
                self.place(index, b);
            }
        }
        self.statics += usize::from(is_active_static(self.flags[i]));
    }
}

impl FilteredBoxes for Store {
    fn index_end(&self) -> u32 {
        self.flags.len() as u32
    }

    fn is_present(&self, index: u32) -> bool {
        self.flags.get(index as usize).is_some_and(|flags| flags & PRESENT != 0)
    }

    fn is_still(&self, index: u32) -> bool {
        self.is_static(index)
    }

    fn set_still(&mut self, index: u32, is_still: bool) {
        self.note_changed(index);
        let flags = &mut self.flags[index as usize];
        self.statics -= usize::from(is_active_static(*flags));
        *flags = if is_still { *flags | STATIC } else { *flags & !STATIC };
        self.statics += usize::from(is_active_static(*flags));
        self.toggle(index);
    }

    fn has_flipped(&self, index: u32) -> bool {
        self.has_changed(index) && self.is_toggled(index)
    }

    fn name(&mut self, index: u32) {
        self.note_named(index);
    }

    fn refilter(&mut self, index: u32) {
        self.note_changed(index);
        let words = self.flags.len().div_ceil(64);
        self.refiltered.resize(words.max(self.refiltered.len()), 0);
        self.refiltered[index as usize / 64] |= 1 << (index % 64);
    }

    fn smaller(&self, pair: [u32; 2]) -> u32 {
        let [a, b] = pair;
        if self.has_changed(a) || self.has_changed(b) {
            return if self.has_changed(a) { a } else { b };
        }
        // Compared in any order of floats: which one it is decides nothing but the time.
        let edge = |index: u32| {
            let b = &self.boxes[index as usize];
            (0..3).map(|axis| b.max[axis] - b.min[axis]).fold(0.0, f32::max)
        };
        if edge(a) <= edge(b) { a } else { b }
    }
}
