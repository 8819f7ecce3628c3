//! Which indices of a scene have a box, which flags and filter data: what the host has to know to check an edit
//! before anything of it is applied, and to decide what began and ended of the pairs that the GPU finds. Some bits a
//! box, and tags where there are any; the boxes themselves are the GPU's.

use pairmask_core::scene::{
    Edit, EditError, EndReason, FilterHistory, FilteredBoxes, Indices, Sets, Step, Tags,
};
use pairmask_shaders::constants::{MARK_NAMES, MARK_REMOVES, MARK_TOUCHES};

/// Flags of a record, as `scene_records.wgsl` has them.
const PRESENT: u32 = 1;
const OFF: u32 = 1 << 1;
const STATIC: u32 = 1 << 2;

/// Indices of a list that are looked at before it is known whether they rise.
const CHECKED_TOGETHER: usize = 1 << 12;

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

/// Indices that an edit removes, flags or gives filter data, each once, with a mark for `scene_mark`.
pub(super) type Marks = Vec<[u32; 2]>;

/// Presence and flags of boxes by index.
#[derive(Debug, Default)]
pub(super) struct Roster {
    /// Indices below this have a place.
    len: usize,
    present: Bits,
    off: Bits,
    /// Boxes that are still: static, and no rule makes an exception of them.
    statics: Bits,
    /// Since the history began: which became still or ceased to be, and which indices lost a box.
    flipped: Bits,
    lost: Bits,
    has_history: bool,
    pub filters: FilterHistory,
    /// Of the edit under way: what it sets (while it is checked), then what it names; what it removes; whose filter
    /// data change; which have a mark.
    seen: Bits,
    removed: Bits,
    touched: Bits,
    marked: Bits,
    pub marks: Marks,
    present_count: usize,
    off_count: usize,
    /// Of those that are switched on.
    pub static_count: usize,
}

impl Roster {
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

    /// Whether a box of a pair was removed since the history began.
    pub fn was_removed(&self, pair: [u32; 2]) -> bool {
        pair.iter().any(|index| self.lost.has(*index))
    }

    pub fn end_reason(&self, pair: [u32; 2]) -> EndReason {
        let any_off = pair.iter().any(|index| self.off.has(*index));
        let are_still = pair.iter().all(|index| self.statics.has(*index));
        if self.was_removed(pair) {
            EndReason::Removed
        } else if any_off || are_still || !self.filters.meet(pair) {
            EndReason::Filtered
        } else {
            EndReason::Separated
        }
    }

    pub fn allocated_bytes(&self) -> usize {
        let Self { present, off, statics, flipped, lost, seen, removed, touched, marked, .. } =
            self;
        let bits = [present, off, statics, flipped, lost, seen, removed, touched, marked];
        bits.iter().map(|bits| bits.0.capacity() * size_of::<u64>()).sum::<usize>()
            + self.marks.capacity() * size_of::<[u32; 2]>()
            + self.filters.allocated_bytes()
    }

    /// Checks an edit. Nothing is applied, but places are made for all that it sets.
    pub fn check(&mut self, edit: Edit<'_>, limit: u32) -> Result<(), EditError> {
        if let Some((indices, boxes)) = edit.uneven() {
            return Err(EditError::Lengths { indices, boxes });
        }
        let last_set = edit.sets().filter_map(|sets| sets.indices.last()).max();
        let last = last_set.max(others_of(edit).filter_map(Indices::last).max());
        let most = last.max(edit.last_listed().map(u64::from));
        if let Some(index) = most.filter(|index| *index >= u64::from(limit)) {
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
    const fn all_bits(&mut self) -> [&mut Bits; 9] {
        let Self { present, off, statics, flipped, lost, seen, removed, touched, marked, .. } =
            self;
        [present, off, statics, flipped, lost, seen, removed, touched, marked]
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
            if let Step::Switch(indices, _)
            | Step::Static(indices, _)
            | Step::Tag(Tags { indices, .. }) = step
            {
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

    pub fn apply(&mut self, edit: Edit<'_>) {
        self.marks.clear();
        let mut filters = std::mem::take(&mut self.filters);
        for step in edit.steps {
            if let Step::Remove(indices) = step {
                indices.for_each(|_, index| {
                    self.remove(index);
                    self.removed.set(index);
                    self.mark(index);
                    filters.remove(index);
                });
            }
        }
        for Sets { indices, .. } in edit.sets() {
            self.insert(indices);
        }
        for step in edit.steps {
            match step {
                Step::Switch(indices, on) => indices.for_each(|_, index| {
                    self.name(index);
                    self.switch(index, *on);
                }),
                Step::Static(indices, on) => {
                    indices.for_each(|_, index| filters.make_static(index, *on, self));
                }
                _ => {}
            }
        }
        filters.apply(edit, self);
        self.filters = filters;
        let mut marks = std::mem::take(&mut self.marks);
        for [index, mark] in &mut marks {
            *mark = self.flags(*index);
            self.marked.clear(*index);
            for (bits, flag) in [
                (&mut self.removed, MARK_REMOVES),
                (&mut self.touched, MARK_TOUCHES),
                (&mut self.seen, MARK_NAMES),
            ] {
                if bits.has(*index) {
                    *mark |= flag;
                    bits.clear(*index);
                }
            }
        }
        self.marks = marks;
    }

    fn mark(&mut self, index: u32) {
        if !self.marked.set(index) {
            self.marks.push([index, 0]);
        }
    }

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
        if self.statics.has(index) {
            self.flip(index);
        }
        for bits in [&mut self.present, &mut self.off, &mut self.statics] {
            bits.clear(index);
        }
        self.lost.set(index);
        self.has_history = true;
    }

    fn flip(&mut self, index: u32) {
        self.has_history = true;
        if self.flipped.set(index) {
            self.flipped.clear(index);
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

    /// The history begins anew. Gives up places at the end that have no box: they cost every pass over all indices. The rule is
    /// that of `pairmask_core::scene`, so that the same edits are wrong.
    pub fn forget(&mut self) {
        self.filters.forget();
        if std::mem::take(&mut self.has_history) {
            self.flipped.0.fill(0);
            self.lost.0.fill(0);
        }
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

impl FilteredBoxes for Roster {
    fn index_end(&self) -> u32 {
        self.len as u32
    }

    fn is_present(&self, index: u32) -> bool {
        (index as usize) < self.len && self.present.has(index)
    }

    fn is_still(&self, index: u32) -> bool {
        self.statics.has(index)
    }

    fn set_still(&mut self, index: u32, is_still: bool) {
        self.mark(index);
        self.flip(index);
        self.static_count -= usize::from(self.is_active_static(index));
        if is_still {
            self.statics.set(index);
        } else {
            self.statics.clear(index);
        }
        self.static_count += usize::from(self.is_active_static(index));
    }

    fn has_flipped(&self, index: u32) -> bool {
        self.flipped.has(index)
    }

    fn name(&mut self, index: u32) {
        self.seen.set(index);
        self.mark(index);
    }

    fn refilter(&mut self, index: u32) {
        self.touched.set(index);
        self.mark(index);
    }

    fn smaller(&self, [a, b]: [u32; 2]) -> u32 {
        // Sizes are not known here: a static box is often the larger one.
        if self.statics.has(a) { b } else { a }
    }
}

/// Indices that an edit names without setting them.
fn others_of(edit: Edit<'_>) -> impl Iterator<Item = &Indices<'_>> {
    edit.steps.iter().filter_map(|step| match step {
        Step::Remove(indices)
        | Step::Switch(indices, _)
        | Step::Static(indices, _)
        | Step::Tag(Tags { indices, .. }) => Some(indices),
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
