//! The boxes of a scene by the client's indices, and their flags.

use std::collections::HashMap;

use super::check::{EDIT_SETS, PRESENT, len_after, mark};
use super::edit::{Edit, Flag};
use super::error::EditError;
use crate::aabb::Aabb;

/// It is switched off.
const OFF: u8 = 1 << 1;
/// It is static.
const STATIC: u8 = 1 << 2;
/// A box of this index was removed since the history began.
const REMOVED: u8 = 1 << 3;
/// Listed among the boxes that the edit under way names.
const NAMED: u8 = 1 << 6;
/// Changed since the history began.
const CHANGED: u8 = 1 << 7;

/// Whether a box is static and switched on.
const fn is_active_static(flags: u8) -> bool {
    flags & (STATIC | OFF) == STATIC
}

/// What collided at an index before it changed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Before {
    pub b: Aabb,
    pub is_static: bool,
}

/// Boxes and flags of a scene, by index.
#[derive(Debug, Default)]
pub(super) struct Store {
    /// What collides: [`Aabb::EMPTY`] for an index without a box, or whose box is switched off.
    boxes: Vec<Aabb>,
    flags: Vec<u8>,
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
    /// What was there then.
    before: Vec<Before>,
    /// Where those begin that changed in the last edit for the first time.
    first_fresh: usize,
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
    pub fn get(&self, index: u32) -> Option<Aabb> {
        let i = index as usize;
        let has = self.flags.get(i).is_some_and(|flags| flags & PRESENT != 0);
        has.then(|| self.parked.get(&index).copied().unwrap_or(self.boxes[i]))
    }

    /// Whether the box of an index is static.
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

    /// Whether any index lost a box since the history began.
    pub fn any_removed(&self) -> bool {
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

    /// What was there when the history began, for each of these.
    pub fn before(&self) -> &[Before] {
        &self.before
    }

    /// Where those of them begin that first changed in the last edit.
    pub const fn first_fresh(&self) -> usize {
        self.first_fresh
    }

    /// Whether an index has changed since the history began.
    #[inline]
    pub fn has_changed(&self, index: u32) -> bool {
        self.flags[index as usize] & CHANGED != 0
    }

    /// Boxes as they collided when the history began, and which of them were static.
    pub fn then(&self) -> (Vec<Aabb>, Vec<bool>) {
        let mut boxes = self.boxes.clone();
        let mut statics: Vec<bool> = self.flags.iter().map(|flags| flags & STATIC != 0).collect();
        for (index, before) in self.changed.iter().zip(&self.before) {
            boxes[*index as usize] = before.b;
            statics[*index as usize] = before.is_static;
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

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let lists = self.removed.capacity()
            + self.named.capacity()
            + self.changed.capacity()
            + self.gone.capacity();
        self.boxes.capacity() * size_of::<Aabb>()
            + self.flags.capacity()
            + lists * size_of::<u32>()
            + self.before.capacity() * size_of::<Before>()
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
        self.before.clear();
        self.first_fresh = 0;
        // Indices at the end without boxes cost every pass over all indices.
        if self.flags.len() > 1024 && self.present < self.flags.len() / 4 {
            self.forget_edit();
            let last = self.flags.iter().rposition(|flags| flags & PRESENT != 0);
            let len = last.map_or(0, |last| last + 1);
            if len < self.flags.len() / 2 {
                self.boxes.truncate(len);
                self.flags.truncate(len);
                self.boxes.shrink_to_fit();
                self.flags.shrink_to_fit();
            }
        }
    }

    fn forget_edit(&mut self) {
        for index in self.named.drain(..) {
            self.flags[index as usize] &= !NAMED;
        }
        self.gone.clear();
        self.is_changed = false;
        self.first_fresh = self.changed.len();
    }

    /// Checks an edit, and applies it if it is right. `limit` is the most boxes that the scene holds.
    ///
    /// # Errors
    /// [`EditError`]; nothing is applied then.
    pub fn apply(&mut self, edit: Edit<'_>, limit: u32) -> Result<(), EditError> {
        self.forget_edit();
        self.make_room(edit, limit)?;
        mark(edit, &mut self.flags)?;
        edit.for_each_removed(|index| self.remove(index));
        edit.for_each_set(|index, b| self.set(index, b));
        edit.for_each_flag(|index, flag| match flag {
            Flag::On(on) => self.switch(index, on),
            Flag::Static(on) => self.make_static(index, on),
        });
        Ok(())
    }

    /// Room for every index that is set, and the checks that need no marks.
    fn make_room(&mut self, edit: Edit<'_>, limit: u32) -> Result<(), EditError> {
        let len = len_after(edit, self.flags.len(), limit)?;
        let more = len - self.flags.len();
        let no_memory = |_| EditError::NoMemory { boxes: len as u64 };
        self.boxes.try_reserve(more).map_err(no_memory)?;
        self.flags.try_reserve(more).map_err(no_memory)?;
        self.boxes.resize(len, Aabb::EMPTY);
        self.flags.resize(len, 0);
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
            let is_static = *flags & STATIC != 0;
            self.changed.push(index);
            self.before.push(Before { b: self.boxes[index as usize], is_static });
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
        *flags = *flags & (CHANGED | NAMED) | REMOVED;
        self.boxes[index as usize] = Aabb::EMPTY;
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
        let here = self.boxes[index as usize];
        // Bits, not floats: floats would call a NaN changed each time, and −0 unchanged, by flags.
        if bytemuck::bytes_of(&here) != bytemuck::bytes_of(&b) {
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

    fn make_static(&mut self, index: u32, on: bool) {
        self.note_named(index);
        if self.is_static(index) != on {
            self.note_changed(index);
            let flags = &mut self.flags[index as usize];
            self.statics -= usize::from(is_active_static(*flags));
            *flags ^= STATIC;
            self.statics += usize::from(is_active_static(*flags));
        }
    }
}
