//! The state of each index of a scene, beside its box: one byte, whose bits are defined here for all that keep boxes.
//! It says which edits are right, which pairs may be, and why they end.

use std::collections::TryReserveError;

use super::answer::EndReason;
use super::edit::{Edit, Indices, Sets};
use super::error::EditError;
use super::rules::FilterHistory;
use crate::fetch::ask_for;
use crate::filters::FilterData;

/// The index has a box.
pub const PRESENT: u8 = 1;
/// The box is disabled.
pub const DISABLED: u8 = 1 << 1;
/// It is still: static, as far as searches may skip pairs of two such boxes.
pub const STILL: u8 = 1 << 2;
/// A box of this index was removed since the history began.
pub const LOST: u8 = 1 << 3;
/// The edit under way removes its box.
pub const EDIT_REMOVES: u8 = 1 << 4;
/// The edit under way sets its box.
pub const EDIT_SETS: u8 = 1 << 5;
/// Listed among the boxes that the edit under way names.
pub const NAMED: u8 = 1 << 6;
/// Changed since the history began.
pub const CHANGED: u8 = 1 << 7;

/// Bits are taken from all indices at once where one in so many has them: a pass over all reads 64 in the time of one
/// that is looked for.
const CLEARED_SHARE: usize = 16;
/// Indices up to which those at the end without boxes are kept: they cost every pass over all indices.
const KEPT_LEAST: usize = 1_024;

/// States by index, and the collision filters of the boxes.
#[derive(Clone, Debug, Default)]
pub struct BoxStates {
    bits: Vec<u8>,
    /// The collision filters.
    pub filters: FilterHistory,
    present: usize,
    disabled: usize,
    /// Still boxes that are enabled.
    active_still: usize,
    /// Whether nobody asks what has changed.
    has_no_history: bool,
    /// Indices that lost a box since the history began.
    lost: Vec<u32>,
    /// User data by index, up to the last one that was given any. Those of a removed box stay until its index has another.
    user_data: Vec<u64>,
    /// Which became still or ceased to be since then; one bit each, for all indices or for none.
    flipped: Vec<u64>,
}

/// Makes room for so many items, and fills it.
///
/// # Errors
/// [`TryReserveError`]; nothing has changed then.
pub fn grow<T: Copy>(entries: &mut Vec<T>, len: usize, with: T) -> Result<(), TryReserveError> {
    entries.try_reserve(len.saturating_sub(entries.len()))?;
    entries.resize(len.max(entries.len()), with);
    Ok(())
}

/// Whether a bit of an index is set.
#[inline]
pub(super) fn has_bit(words: &[u64], index: u32) -> bool {
    words.get(index as usize / 64).is_some_and(|word| word >> (index % 64) & 1 == 1)
}

const fn is_active_still(bits: u8) -> bool {
    bits & (STILL | DISABLED) == STILL
}

impl BoxStates {
    /// States that do not say what has changed.
    pub(super) fn without_history() -> Self {
        Self { has_no_history: true, ..Self::default() }
    }

    /// Indices of boxes are below this.
    #[inline]
    pub const fn index_end(&self) -> usize {
        self.bits.len()
    }

    /// Indices with a box.
    pub const fn present(&self) -> usize {
        self.present
    }

    /// Boxes that are enabled.
    pub const fn active(&self) -> usize {
        self.present - self.disabled
    }

    /// Those of them that are still.
    pub const fn active_still(&self) -> usize {
        self.active_still
    }

    /// Asks for the bits of an index.
    #[inline]
    pub(super) fn ask_for(&self, index: u32) {
        ask_for(&self.bits, index);
    }

    /// Whether any of these bits of an index is set.
    #[inline]
    pub fn has(&self, index: u32, bits: u8) -> bool {
        self.bits.get(index as usize).is_some_and(|own| own & bits != 0)
    }

    /// Whether an index has a box that is enabled.
    #[inline]
    pub(super) fn is_active(&self, index: u32) -> bool {
        self.bits[index as usize] & (PRESENT | DISABLED) == PRESENT
    }

    /// Bits by index.
    pub fn bits(&self) -> &[u8] {
        &self.bits
    }

    /// As [`bits`](Self::bits), to be written. Who sets [`PRESENT`] says [how often](Self::note_inserted).
    #[inline]
    pub(super) fn bits_mut(&mut self) -> &mut [u8] {
        &mut self.bits
    }

    pub(super) const fn note_inserted(&mut self, count: usize) {
        self.present += count;
    }

    /// The filter data of a box, with its own static flag.
    pub fn filter_data(&self, index: u32) -> FilterData {
        self.filters.filter_data(index, self.has(index, STILL))
    }

    /// Whether two boxes may be a pair, wherever they are.
    #[inline]
    pub fn may_meet(&self, pair: [u32; 2]) -> bool {
        !pair.iter().all(|index| self.has(*index, STILL)) && self.filters.meet(pair)
    }

    /// Whether a box of a pair has any of these bits.
    #[inline]
    pub fn has_either(&self, pair: [u32; 2], bits: u8) -> bool {
        pair.iter().any(|index| self.has(*index, bits))
    }

    /// Why a pair ended, by the states of now.
    pub fn end_reason(&self, pair: [u32; 2]) -> EndReason {
        if self.has_either(pair, LOST) {
            EndReason::Removed
        } else if self.has_either(pair, DISABLED) || !self.may_meet(pair) {
            EndReason::Filtered
        } else {
            EndReason::Separated
        }
    }

    /// Whether a box is still and was not when the history began, or the other way round.
    #[inline]
    pub(super) fn has_flipped(&self, index: u32) -> bool {
        has_bit(&self.flipped, index)
    }

    /// Whether any index lost a box since the history began.
    pub(super) const fn has_lost(&self) -> bool {
        !self.lost.is_empty()
    }

    /// The user data of an index, also after its box was removed, until another has the index.
    #[inline]
    pub fn user_data(&self, index: u32) -> u64 {
        self.user_data.get(index as usize).copied().unwrap_or(0)
    }

    /// Drops the user data of indices that a checked edit gives another box, after its removals and before its sets.
    pub fn drop_user_data(&mut self, edit: Edit<'_>) {
        if self.user_data.is_empty() {
            return;
        }
        edit.for_each_set(|index, _| {
            if self.bits[index as usize] & PRESENT == 0
                && let Some(of_removed) = self.user_data.get_mut(index as usize)
            {
                *of_removed = 0;
            }
        });
    }

    /// Gives boxes the user data of an edit that was checked.
    pub(super) fn set_user_data(&mut self, edit: Edit<'_>) {
        edit.for_each_user_data(|index, user_data| {
            if self.user_data.len() <= index as usize {
                self.user_data.resize(index as usize + 1, 0);
            }
            self.user_data[index as usize] = user_data;
        });
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.bits.capacity()
            + self.user_data.capacity() * size_of::<u64>()
            + self.filters.allocated_bytes()
            + self.lost.capacity() * size_of::<u32>()
            + self.flipped.capacity() * size_of::<u64>()
    }

    /// Checks an edit of a scene whose indices are below `limit`. Where it is right, there is a place for each index,
    /// by `room` in what is kept beside the states, and the edit is to follow, or to be unmarked.
    ///
    /// # Errors
    /// [`EditError`]; the edit is dropped then.
    pub fn check(
        &mut self,
        edit: Edit<'_>,
        limit: u32,
        room: impl FnOnce(usize) -> Result<(), TryReserveError>,
    ) -> Result<(), EditError> {
        let len = self.len_after(edit, limit)?;
        let no_memory = |_| EditError::NoMemory { boxes: len as u64 };
        let more = len - self.bits.len();
        self.bits.try_reserve(more).and_then(|()| room(len)).map_err(no_memory)?;
        if edit.gives_user_data() {
            let more = len.saturating_sub(self.user_data.len());
            self.user_data.try_reserve(more).map_err(no_memory)?;
        }
        self.bits.resize(len, 0);
        if edit.is_plainly_right() { Ok(()) } else { self.mark(edit) }
    }

    /// Indices after an edit: every one that is set, and those before.
    fn len_after(&self, edit: Edit<'_>, limit: u32) -> Result<usize, EditError> {
        if let Some((indices, boxes)) = edit.uneven() {
            return Err(EditError::Lengths { indices, boxes });
        }
        let last_set = edit.last_set();
        let last = last_set.max(edit.last_named());
        let listed = edit.last_listed().map(u64::from);
        for most in [listed, last] {
            if let Some(index) = most.filter(|index| *index >= u64::from(limit)) {
                return Err(EditError::BeyondLimit { index, limit });
            }
        }
        let len = last_set.map_or(0, |last| last as usize + 1).max(self.bits.len());
        match last.filter(|index| *index >= len as u64) {
            Some(index) => Err(EditError::Absent { index }),
            None => Ok(len),
        }
    }

    /// Marks what an edit removes and sets, and finds what is wrong.
    fn mark(&mut self, edit: Edit<'_>) -> Result<(), EditError> {
        let bits = &mut self.bits;
        let mut wrong = None;
        edit.for_each_removed(|index| {
            let bits = &mut bits[index as usize];
            if *bits & PRESENT == 0 || *bits & EDIT_REMOVES != 0 {
                wrong = wrong.or(Some(EditError::Absent { index: u64::from(index) }));
            }
            *bits |= EDIT_REMOVES;
        });
        for sets in edit.sets() {
            if let Indices::Range { first, count } = sets.indices {
                // Without a branch an index: a scene that moves as a whole is such a range.
                let bits = range_of(bits, first, count);
                if bits.iter().fold(0, |all, bits| all | bits) & EDIT_SETS != 0 {
                    let twice = bits.iter().position(|bits| bits & EDIT_SETS != 0).unwrap_or(0);
                    wrong = wrong.or(Some(EditError::SetTwice { index: first + twice as u32 }));
                }
                for bits in bits {
                    *bits |= EDIT_SETS;
                }
                continue;
            }
            sets.indices.for_each(|_, index| {
                let bits = &mut bits[index as usize];
                if *bits & EDIT_SETS != 0 {
                    wrong = wrong.or(Some(EditError::SetTwice { index }));
                }
                *bits |= EDIT_SETS;
            });
        }
        let mut check = |index: u32| {
            let bits = bits[index as usize];
            let stays = bits & (PRESENT | EDIT_REMOVES) == PRESENT;
            if !stays && bits & EDIT_SETS == 0 {
                wrong = wrong.or(Some(EditError::Absent { index: u64::from(index) }));
            }
        };
        edit.for_each_flag(|index, _| check(index));
        edit.for_each_filter_data(|index, _| check(index));
        edit.for_each_user_data(|index, _| check(index));
        let Some(wrong) = wrong else { return Ok(()) };
        self.unmark(edit);
        Err(wrong)
    }

    /// Drops an edit that was [checked](Self::check). Every index that may be marked is among its own.
    pub(super) fn unmark(&mut self, edit: Edit<'_>) {
        const MARKS: u8 = EDIT_REMOVES | EDIT_SETS;
        let bits = &mut self.bits;
        edit.for_each_removed(|index| bits[index as usize] &= !MARKS);
        for sets in edit.sets() {
            match sets.indices {
                // Without a look at each index, as it was marked.
                Indices::Range { first, count } => {
                    for bits in range_of(bits, first, count) {
                        *bits &= !MARKS;
                    }
                }
                indices => indices.for_each(|_, index| bits[index as usize] &= !MARKS),
            }
        }
    }

    /// Sets bits of an index; whether any of them was set.
    #[inline]
    pub(super) fn set(&mut self, index: u32, bits: u8) -> bool {
        let own = &mut self.bits[index as usize];
        let before = std::mem::replace(own, *own | bits);
        before & bits != 0
    }

    /// Takes bits away from some indices, which no other index has.
    pub(super) fn clear_all(&mut self, indices: &[u32], bits: u8) {
        if indices.len() * CLEARED_SHARE > self.bits.len() {
            // Without a look at each of them, in registers of many.
            self.bits.iter_mut().for_each(|own| *own &= !bits);
        } else {
            for index in indices {
                self.bits[*index as usize] &= !bits;
            }
        }
    }

    /// A checked edit sets the box of an index.
    #[inline]
    pub(super) fn insert(&mut self, index: u32) {
        let bits = &mut self.bits[index as usize];
        self.present += usize::from(*bits & PRESENT == 0);
        *bits = *bits & !EDIT_SETS | PRESENT;
    }

    /// Notes all boxes that the edit sets.
    pub fn insert_all(&mut self, edit: Edit<'_>) {
        if self.present == self.bits.len() && edit.is_plainly_right() {
            // No index is without a box, and none is marked.
            return;
        }
        for Sets { indices, .. } in edit.sets() {
            match *indices {
                Indices::Range { first, count } => self.insert_range(first, count),
                indices => indices.for_each(|_, index| self.insert(index)),
            }
        }
    }

    /// As [`insert`](Self::insert), for boxes of indices that follow each other.
    pub(super) fn insert_range(&mut self, first: u32, count: u32) {
        let bits = range_of(&mut self.bits, first, count);
        let present: u64 = bits.iter().map(|bits| u64::from(bits & PRESENT)).sum();
        self.present += bits.len() - (present / u64::from(PRESENT)) as usize;
        for bits in bits {
            *bits = *bits & !EDIT_SETS | PRESENT;
        }
    }

    /// The box of an index is removed, with its filter data: the next one has its own. Its bits before.
    pub fn remove(&mut self, index: u32) -> u8 {
        let bits = &mut self.bits[index as usize];
        let before = *bits;
        *bits &= LOST | EDIT_SETS | NAMED | CHANGED;
        self.present -= 1;
        self.disabled -= usize::from(before & DISABLED != 0);
        self.active_still -= usize::from(is_active_still(before));
        if before & LOST == 0 && !self.has_no_history {
            *bits |= LOST;
            self.lost.push(index);
        }
        if before & STILL != 0 {
            self.flip(index);
        }
        self.filters.remove(index);
        before
    }

    /// Enables or disables the box of an index; whether it was the other.
    pub fn enable(&mut self, index: u32, on: bool) -> bool {
        let before = self.bits[index as usize];
        if (before & DISABLED == 0) == on {
            return false;
        }
        self.bits[index as usize] ^= DISABLED;
        let moves = usize::from(before & STILL != 0);
        if on {
            (self.disabled, self.active_still) = (self.disabled - 1, self.active_still + moves);
        } else {
            (self.disabled, self.active_still) = (self.disabled + 1, self.active_still - moves);
        }
        true
    }

    /// Makes a box still or not; it was the other.
    pub(super) fn set_still(&mut self, index: u32, is_still: bool) {
        let bits = &mut self.bits[index as usize];
        self.active_still -= usize::from(is_active_still(*bits));
        *bits = if is_still { *bits | STILL } else { *bits & !STILL };
        self.active_still += usize::from(is_active_still(*bits));
        self.flip(index);
    }

    fn flip(&mut self, index: u32) {
        if !self.has_no_history {
            self.flipped.resize(self.bits.len().div_ceil(64).max(self.flipped.len()), 0);
            self.flipped[index as usize / 64] ^= 1 << (index % 64);
        }
    }

    /// The history begins anew. Where most indices at the end have no box any more, they are given up: how many are left
    /// then. The rule is the same for all who keep a scene, so that the same edits are wrong.
    pub fn discard(&mut self) -> Option<usize> {
        self.filters.discard();
        self.lost.drain(..).for_each(|index| self.bits[index as usize] &= !LOST);
        self.flipped.clear();
        let len = self.bits.len();
        if len <= KEPT_LEAST || self.present >= len / 4 {
            return None;
        }
        let left =
            self.bits.iter().rposition(|bits| bits & PRESENT != 0).map_or(0, |last| last + 1);
        (left < len / 2).then(|| {
            self.bits.truncate(left);
            self.bits.shrink_to_fit();
            left
        })
    }
}

/// The bits of indices that follow each other. The first index of none may be anything.
fn range_of(bits: &mut [u8], first: u32, count: u32) -> &mut [u8] {
    let first = if count == 0 { 0 } else { first as usize };
    &mut bits[first..first + count as usize]
}
