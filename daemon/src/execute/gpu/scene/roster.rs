//! Which indices of a scene have a box, and which flags: what the host has to know to check an edit
//! before anything of it is applied. A bit or two a box; the boxes themselves are the GPU's.

use pairmask_core::scene::{Edit, EditError, Indices, Sets, Step};
use pairmask_shaders::constants::{MARK_NAMES, MARK_REMOVES};

/// Flags of a record, as `scene_records.wgsl` has them.
const PRESENT: u32 = 1;
const OFF: u32 = 1 << 1;
const STATIC: u32 = 1 << 2;

/// Indices of a list that are looked at before it is known whether they rise.
const CHECKED_TOGETHER: usize = 1 << 12;

/// Bits by index.
#[derive(Debug, Default)]
struct Bits(Vec<u64>);

impl Bits {
    #[inline]
    fn has(&self, index: u32) -> bool {
        self.0[index as usize / 64] >> (index % 64) & 1 != 0
    }

    /// Sets a bit; whether it was set.
    #[inline]
    fn set(&mut self, index: u32) -> bool {
        let (word, bit) = (&mut self.0[index as usize / 64], 1 << (index % 64));
        let was = *word & bit != 0;
        *word |= bit;
        was
    }

    #[inline]
    fn clear(&mut self, index: u32) {
        self.0[index as usize / 64] &= !(1 << (index % 64));
    }

    /// Sets a range of bits; how many were not.
    fn set_range(&mut self, first: u32, count: u32) -> usize {
        let (mut at, end) = (u64::from(first), u64::from(first) + u64::from(count));
        let mut fresh = 0;
        while at < end {
            let low = at % 64;
            let len = (64 - low).min(end - at);
            let bits = (u64::MAX >> (64 - len)) << low;
            let word = &mut self.0[(at / 64) as usize];
            fresh += (bits & !*word).count_ones() as usize;
            *word |= bits;
            at += len;
        }
        fresh
    }

    fn last(&self) -> Option<usize> {
        let word = self.0.iter().rposition(|word| *word != 0)?;
        Some(64 * word + 63 - self.0[word].leading_zeros() as usize)
    }
}

/// Indices that an edit removes or flags, each once, with a mark for `scene_mark`.
pub(super) type Marks = Vec<[u32; 2]>;

/// Presence and flags of boxes by index.
#[derive(Debug, Default)]
pub(super) struct Roster {
    /// Indices below this have a place.
    len: usize,
    present: Bits,
    off: Bits,
    statics: Bits,
    /// Of the edit under way: what it sets (while it is checked), then what it flags; what it removes.
    seen: Bits,
    removed: Bits,
    present_count: usize,
    off_count: usize,
    static_count: usize,
}

impl Roster {
    /// Indices below this have a place.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Indices with a box.
    pub const fn present(&self) -> usize {
        self.present_count
    }

    /// Boxes that are switched on.
    pub const fn active(&self) -> usize {
        self.present_count - self.off_count
    }

    /// Whether an index has a box.
    pub fn is_present(&self, index: u32) -> bool {
        (index as usize) < self.len && self.present.has(index)
    }

    /// Whether an index has a box that is switched off.
    pub fn is_off(&self, index: u32) -> bool {
        (index as usize) < self.len && self.off.has(index)
    }

    /// Whether an index has a static box.
    pub fn is_static(&self, index: u32) -> bool {
        (index as usize) < self.len && self.statics.has(index)
    }

    /// Static boxes that are switched on.
    pub const fn statics(&self) -> usize {
        self.static_count
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let bits = [&self.present, &self.off, &self.statics, &self.seen, &self.removed];
        bits.iter().map(|bits| bits.0.capacity() * size_of::<u64>()).sum()
    }

    /// Checks an edit. Nothing is applied, but places are made for all that it sets.
    ///
    /// # Errors
    /// [`EditError`].
    pub fn check(&mut self, edit: Edit<'_>, limit: u32) -> Result<(), EditError> {
        let uneven = edit.sets().find(|sets| sets.indices.len() != sets.boxes.len());
        if let Some(Sets { indices, boxes }) = uneven {
            return Err(EditError::Lengths { indices: indices.len(), boxes: boxes.len() });
        }
        let last_set = edit.sets().filter_map(|sets| sets.indices.last()).max();
        let last = last_set.max(others_of(edit).filter_map(Indices::last).max());
        if let Some(index) = last.filter(|index| *index >= u64::from(limit)) {
            return Err(EditError::BeyondLimit { index, limit });
        }
        let len = last_set.map_or(0, |last| last as usize + 1).max(self.len);
        if let Some(index) = last.filter(|index| *index >= len as u64) {
            return Err(EditError::Absent { index });
        }
        self.make_room(len)?;
        if is_plainly_right(edit) { Ok(()) } else { self.check_marked(edit) }
    }

    /// Every kind of bits that it keeps.
    const fn all_bits(&mut self) -> [&mut Bits; 5] {
        let Self { present, off, statics, seen, removed, .. } = self;
        [present, off, statics, seen, removed]
    }

    fn make_room(&mut self, len: usize) -> Result<(), EditError> {
        let words = len.div_ceil(64);
        for Bits(bits) in self.all_bits() {
            let more = words.saturating_sub(bits.len());
            bits.try_reserve(more).map_err(|_| EditError::NoMemory { boxes: len as u64 })?;
            bits.resize(words.max(bits.len()), 0);
        }
        self.len = len;
        Ok(())
    }

    fn check_marked(&mut self, edit: Edit<'_>) -> Result<(), EditError> {
        let mut wrong = None;
        let absent = |index| EditError::Absent { index: u64::from(index) };
        for step in edit.steps {
            if let Step::Remove(indices) = step {
                indices.for_each(|_, index| {
                    if self.removed.set(index) || !self.present.has(index) {
                        wrong = wrong.or(Some(absent(index)));
                    }
                });
            }
        }
        for sets in edit.sets() {
            sets.indices.for_each(|_, index| {
                if self.seen.set(index) {
                    wrong = wrong.or(Some(EditError::SetTwice { index }));
                }
            });
        }
        for step in edit.steps {
            if let Step::Switch(indices, _) | Step::Static(indices, _) = step {
                indices.for_each(|_, index| {
                    let stays = self.present.has(index) && !self.removed.has(index);
                    if !stays && !self.seen.has(index) {
                        wrong = wrong.or(Some(absent(index)));
                    }
                });
            }
        }
        for sets in edit.sets() {
            sets.indices.for_each(|_, index| self.seen.clear(index));
        }
        for step in edit.steps {
            if let Step::Remove(indices) = step {
                indices.for_each(|_, index| self.removed.clear(index));
            }
        }
        wrong.map_or(Ok(()), Err)
    }

    /// Applies an edit that was checked. `marks` are those for the GPU.
    pub fn apply(&mut self, edit: Edit<'_>, marks: &mut Marks) {
        marks.clear();
        for step in edit.steps {
            if let Step::Remove(indices) = step {
                indices.for_each(|_, index| {
                    self.remove(index);
                    self.removed.set(index);
                    marks.push([index, 0]);
                });
            }
        }
        for Sets { indices, .. } in edit.sets() {
            self.insert(indices);
        }
        for step in edit.steps {
            let (Step::Switch(indices, _) | Step::Static(indices, _)) = step else { continue };
            indices.for_each(|_, index| {
                if !self.seen.set(index) && !self.removed.has(index) {
                    marks.push([index, 0]);
                }
                match step {
                    Step::Switch(_, on) => self.switch(index, *on),
                    Step::Static(_, on) => self.make_static(index, *on),
                    _ => {}
                }
            });
        }
        for [index, mark] in marks {
            *mark = self.flags(*index);
            if self.removed.has(*index) {
                *mark |= MARK_REMOVES;
                self.removed.clear(*index);
            }
            if self.seen.has(*index) {
                *mark |= MARK_NAMES;
                self.seen.clear(*index);
            }
        }
    }

    /// The flags of an index.
    fn flags(&self, index: u32) -> u32 {
        let flag = |bits: &Bits, flag| if bits.has(index) { flag } else { 0 };
        flag(&self.present, PRESENT) | flag(&self.off, OFF) | flag(&self.statics, STATIC)
    }

    fn insert(&mut self, indices: &Indices<'_>) {
        if self.present_count == self.len {
            // No index is without a box.
            return;
        }
        if let Indices::Range { first, count } = indices {
            if *count > 0 {
                self.present_count += self.present.set_range(*first, *count);
            }
            return;
        }
        indices.for_each(|_, index| {
            self.present_count += usize::from(!self.present.set(index));
        });
    }

    fn is_active_static(&self, index: u32) -> bool {
        self.statics.has(index) && !self.off.has(index)
    }

    fn remove(&mut self, index: u32) {
        self.present_count -= 1;
        self.static_count -= usize::from(self.is_active_static(index));
        self.off_count -= usize::from(self.off.has(index));
        for bits in [&mut self.present, &mut self.off, &mut self.statics] {
            bits.clear(index);
        }
    }

    fn switch(&mut self, index: u32, on: bool) {
        self.static_count -= usize::from(self.is_active_static(index));
        self.off_count -= usize::from(self.off.has(index));
        if on {
            self.off.clear(index);
        } else {
            self.off.set(index);
            self.off_count += 1;
        }
        self.static_count += usize::from(self.is_active_static(index));
    }

    fn make_static(&mut self, index: u32, on: bool) {
        self.static_count -= usize::from(self.is_active_static(index));
        if on {
            self.statics.set(index);
        } else {
            self.statics.clear(index);
        }
        self.static_count += usize::from(self.is_active_static(index));
    }

    /// Gives up places at the end that have no box: they cost every pass over all indices. The rule is
    /// that of `pairmask_core::scene`, so that the same edits are wrong.
    pub fn forget(&mut self) {
        if self.len <= 1024 || self.present_count >= self.len / 4 {
            return;
        }
        let len = self.present.last().map_or(0, |last| last + 1);
        if len < self.len / 2 {
            self.len = len;
            for Bits(bits) in self.all_bits() {
                bits.truncate(len.div_ceil(64));
                bits.shrink_to_fit();
            }
        }
    }
}

/// Indices that an edit names without setting them.
fn others_of(edit: Edit<'_>) -> impl Iterator<Item = &Indices<'_>> {
    edit.steps.iter().filter_map(|step| match step {
        Step::Remove(indices) | Step::Switch(indices, _) | Step::Static(indices, _) => {
            Some(indices)
        }
        _ => None,
    })
}

/// Whether an edit sets boxes and no more, each of them once: as a range, or as a rising list.
fn is_plainly_right(edit: Edit<'_>) -> bool {
    match edit.steps {
        [Step::Set(Sets { indices: Indices::List(list), .. })] => {
            // Counted without a branch an index: a tenth of a nanosecond.
            let falls = |chunk: &[u32]| {
                let pairs = chunk.iter().zip(chunk.get(1..).unwrap_or_default());
                pairs.map(|(a, b)| u32::from(a >= b)).sum::<u32>()
            };
            list.chunks(CHECKED_TOGETHER).enumerate().all(|(at, chunk)| {
                let before = (at * CHECKED_TOGETHER).checked_sub(1).map(|last| list[last]);
                before.is_none_or(|before| before < chunk[0]) && falls(chunk) == 0
            })
        }
        [] | [Step::Set(_)] => true,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_ranges_are_those_of_each_index() {
        for (first, count) in [(0, 0), (0, 64), (3, 61), (3, 62), (63, 1), (64, 129), (5, 200)] {
            let (mut one, mut all) = (Bits(vec![0; 5]), Bits(vec![0; 5]));
            one.set(70);
            all.set(70);
            let fresh = (first..first + count).filter(|index| !one.set(*index)).count();
            assert_eq!(all.set_range(first, count), fresh, "{first} {count}");
            assert_eq!(one.0, all.0);
        }
    }

    #[test]
    fn only_lists_that_rise_are_plainly_right() {
        let boxes = vec![pairmask_core::Aabb::EMPTY; 5_000];
        let mut list: Vec<u32> = (0..5_000).collect();
        let is_right = |list: &[u32]| {
            let steps = [Step::Set(Sets { indices: list.into(), boxes: &boxes })];
            is_plainly_right(Edit { steps: &steps })
        };
        assert!(is_right(&list) && is_right(&list[..1]) && is_right(&[]));
        for at in [0, 1, 4_095, 4_096, 4_998] {
            list[at] = at as u32 + 1;
            assert!(!is_right(&list), "{at}");
            list[at] = at as u32;
        }
    }
}
