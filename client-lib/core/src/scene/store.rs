//! The states of a scene's boxes by the client's indices, as they are and as they were when the history began:
//! box, and its [state](super::states).

mod rising;

use std::collections::HashMap;

use self::rising::Rising;
use super::edit::{Edit, Indices, Sets};
use super::error::EditError;
use super::rules::{FilteredBoxes, apply_rules};
use super::states::{BoxStates, CHANGED, DISABLED, NAMED, PRESENT, STILL, grow, has_bit};
use crate::aabb::Aabb;
use crate::fetch::ask_for;
use crate::huge_pages;

/// Boxes that are asked for this many before they are set, where their indices are a list: so many misses of the caches
/// overlap.
const AHEAD: usize = 16;

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

/// Boxes and states of a scene, by index.
#[derive(Debug, Default)]
pub(super) struct Store {
    /// What collides: [`Aabb::EMPTY`] for an index without a box, or whose box is disabled.
    boxes: Vec<Aabb>,
    /// Whether they are there, on, still, and more.
    pub states: BoxStates,
    /// What collided when the history began, at indices that have changed since.
    then: Vec<Aabb>,
    /// Whose filter data have changed since the history began; one bit each, for all indices or for none.
    refiltered: Vec<u64>,
    /// Boxes that are disabled.
    disabled: HashMap<u32, Aabb>,
    /// Indices that the last edit set, enabled or disabled or flagged.
    named: Vec<u32>,
    /// Indices that the last edit removed and did not set anew.
    ended: Vec<u32>,
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

    /// The box of an index, also one that is disabled.
    #[inline]
    pub fn get(&self, index: u32) -> Option<Aabb> {
        let of = || self.disabled.get(&index).copied().unwrap_or(self.boxes[index as usize]);
        self.states.has(index, PRESENT).then(of)
    }

    /// Whether filter data of a box have changed since the history began.
    #[inline]
    pub fn is_refiltered(&self, index: u32) -> bool {
        has_bit(&self.refiltered, index)
    }

    /// Whether the last edit changed anything.
    pub const fn is_changed(&self) -> bool {
        self.is_changed
    }

    /// Indices that have changed since the history began, in the order in which they first did.
    pub fn changed(&self) -> &[u32] {
        &self.changed
    }

    #[inline]
    pub fn now(&self, index: u32) -> BoxState {
        BoxState { b: self.boxes[index as usize], is_static: self.states.has(index, STILL) }
    }

    /// What collided at an index when the history began, if that has changed.
    #[inline]
    pub fn before(&self, index: u32) -> Option<BoxState> {
        let states = &self.states;
        let was_static = || states.has(index, STILL) != states.has_flipped(index);
        let was = || BoxState { b: self.then[index as usize], is_static: was_static() };
        states.has(index, CHANGED).then(was)
    }

    #[inline]
    pub fn ask_for(&self, index: u32) {
        self.ask_for_box(index);
        ask_for(&self.then, index);
        ask_for(&self.then, index + 1);
        self.states.ask_for(index);
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
        let bits = self.states.bits().iter();
        let mut statics: Vec<bool> = bits.map(|bits| bits & STILL != 0).collect();
        for &index in &self.changed {
            if let Some(before) = self.before(index) {
                boxes[index as usize] = before.b;
                statics[index as usize] = before.is_static;
            }
        }
        (boxes, statics)
    }

    /// Indices that the last edit removed.
    pub fn ended(&self) -> &[u32] {
        &self.ended
    }

    /// Indices that the last edit set, enabled or disabled or flagged.
    pub fn named(&self) -> &[u32] {
        &self.named
    }

    pub fn allocated_bytes(&self) -> usize {
        let lists = self.named.capacity() + self.changed.capacity() + self.ended.capacity();
        (self.boxes.capacity() + self.then.capacity()) * size_of::<Aabb>()
            + self.states.allocated_bytes()
            + self.refiltered.capacity() * size_of::<u64>()
            + lists * size_of::<u32>()
            + self.disabled.capacity() * (size_of::<(u32, Aabb)>() + 1)
    }

    /// The history begins anew.
    pub fn discard(&mut self) {
        self.states.clear_all(&self.changed, CHANGED);
        self.changed.clear();
        self.refiltered.clear();
        if let Some(len) = self.states.discard() {
            // Of those that it named, some may have no place any more.
            self.named.retain(|index| (*index as usize) < len);
            self.discard_edit();
            for boxes in [&mut self.boxes, &mut self.then] {
                boxes.truncate(len);
                boxes.shrink_to_fit();
            }
        }
    }

    fn discard_edit(&mut self) {
        self.states.clear_all(&self.named, NAMED);
        self.named.clear();
        self.ended.clear();
        self.is_changed = false;
    }

    /// Checks an edit, and applies it if it is right. `limit` is the most boxes that the scene holds.
    ///
    /// # Errors
    /// [`EditError`]; nothing is applied then.
    pub fn apply(&mut self, edit: Edit<'_>, limit: u32, threads: usize) -> Result<(), EditError> {
        self.discard_edit();
        let Self { boxes, states, then, .. } = self;
        states.check(edit, limit, |len| {
            boxes.try_reserve(len - boxes.len())?;
            huge_pages::prefer(boxes);
            grow(then, len, Aabb::EMPTY)?;
            grow(boxes, len, Aabb::EMPTY)
        })?;
        edit.for_each_removed(|index| self.remove(index));
        self.states.drop_user_data(edit);
        self.set_all(edit, threads);
        apply_rules(edit, self);
        Ok(())
    }

    /// Sets the boxes of an edit that was checked.
    fn set_all(&mut self, edit: Edit<'_>, threads: usize) {
        for Sets { indices, boxes } in edit.sets() {
            let listed = Rising::listed(*indices, boxes.len());
            let indices = listed.as_deref().map_or(*indices, Indices::List);
            match (Rising::of(indices, boxes.len()), indices) {
                (Some(rising), _) => self.set_rising(rising, boxes, threads),
                (None, Indices::List(list)) => {
                    for (at, (index, b)) in list.iter().zip(*boxes).enumerate() {
                        if let Some(ahead) = list.get(at + AHEAD) {
                            self.ask_for(*ahead);
                        }
                        self.set(*index, b);
                    }
                }
                (None, indices) => indices.for_each(|at, index| self.set(index, &boxes[at])),
            }
        }
    }

    fn remove(&mut self, index: u32) {
        self.change(index);
        self.ended.push(index);
        if self.states.remove(index) & DISABLED != 0 {
            self.disabled.remove(&index);
        }
        self.boxes[index as usize] = Aabb::EMPTY;
    }

    #[inline]
    fn set(&mut self, index: u32, b: &Aabb) {
        self.states.insert(index);
        self.name(index);
        if self.states.has(index, DISABLED) {
            self.disabled.insert(index, *b);
        } else {
            self.put(index, *b);
        }
    }

    /// Puts what collides at an index.
    #[inline]
    fn put(&mut self, index: u32, b: Aabb) {
        if !are_same(&self.boxes[index as usize], &b) {
            self.change(index);
            self.boxes[index as usize] = b;
        }
    }
}

impl FilteredBoxes for Store {
    fn states(&self) -> &BoxStates {
        &self.states
    }

    fn states_mut(&mut self) -> &mut BoxStates {
        &mut self.states
    }

    fn enable(&mut self, index: u32, on: bool) {
        if !self.states.enable(index, on) {
            return;
        }
        if !on {
            self.disabled.insert(index, self.boxes[index as usize]);
            self.put(index, Aabb::EMPTY);
        } else if let Some(b) = self.disabled.remove(&index) {
            self.put(index, b);
        }
    }

    #[inline]
    fn name(&mut self, index: u32) {
        if !self.states.set(index, NAMED) {
            self.named.push(index);
        }
    }

    /// Notes an index that is about to change.
    #[inline]
    fn change(&mut self, index: u32) {
        self.is_changed = true;
        if !self.states.set(index, CHANGED) {
            self.changed.push(index);
            self.then[index as usize] = self.boxes[index as usize];
        }
    }

    fn refilter(&mut self, index: u32) {
        self.change(index);
        let words = self.boxes.len().div_ceil(64);
        self.refiltered.resize(words.max(self.refiltered.len()), 0);
        self.refiltered[index as usize / 64] |= 1 << (index % 64);
    }

    fn smaller(&self, pair: [u32; 2]) -> u32 {
        let [a, b] = pair;
        if let Some(changed) = pair.into_iter().find(|index| self.states.has(*index, CHANGED)) {
            return changed;
        }
        // Compared in any order of floats: which one it is decides nothing but the time.
        let edge = |index: u32| {
            let b = &self.boxes[index as usize];
            (0..3).map(|axis| b.max[axis] - b.min[axis]).fold(0.0, f32::max)
        };
        if edge(a) <= edge(b) { a } else { b }
    }
}
