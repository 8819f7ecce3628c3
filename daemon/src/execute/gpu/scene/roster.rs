//! Which indices of a scene have a box, which flags and filter data: what the host has to know to check an edit
//! before anything of it is applied, and to decide what began and ended of the pairs that the GPU finds. Two bytes a
//! box, and filter data where there are any; the boxes themselves are the GPU's.

use pairmask_core::scene::states::{BoxStates, DISABLED, PRESENT, STILL, grow};
use pairmask_core::scene::{Edit, EditError, FilteredBoxes, apply_rules};
use pairmask_shaders::constants::{MARK_NAMES, MARK_REMOVES, MARK_TOUCHES};

/// Flags of a record, as `scene_records.wgsl` has them.
const FLAGS: u8 = PRESENT | DISABLED | STILL;
const _: () = assert!(PRESENT == 1 && DISABLED == 2 && STILL == 4);

/// What the edit under way says of an index, in a byte: where the marks are, and that there are some.
const MARKS_AT: u32 = 8;
const IS_MARKED: u32 = 1 << 15;

/// Indices that an edit removes, flags or gives filter data, each once, with a mark for `scene_mark`.
pub(super) type Marks = Vec<[u32; 2]>;

#[derive(Debug, Default)]
pub(super) struct Roster {
    pub states: BoxStates,
    /// What the edit under way says of each index.
    said: Vec<u8>,
    pub marks: Marks,
}

impl Roster {
    pub fn allocated_bytes(&self) -> usize {
        self.states.allocated_bytes()
            + self.said.capacity()
            + self.marks.capacity() * size_of::<[u32; 2]>()
    }

    /// Checks an edit. Nothing is applied, but places are made for all that it sets.
    pub fn check(&mut self, edit: Edit<'_>, limit: u32) -> Result<(), EditError> {
        self.states.check(edit, limit, |len| grow(&mut self.said, len, 0))
    }

    pub fn apply(&mut self, edit: Edit<'_>) {
        self.marks.clear();
        edit.for_each_removed(|index| {
            self.states.remove(index);
            self.mark(index, MARK_REMOVES);
        });
        self.states.drop_user_data(edit);
        self.states.insert_all(edit);
        apply_rules(edit, self);
        for [index, mark] in &mut self.marks {
            let said = std::mem::take(&mut self.said[*index as usize]);
            *mark = u32::from(said) << MARKS_AT & !IS_MARKED;
            *mark |= u32::from(self.states.bits()[*index as usize] & FLAGS);
        }
    }

    fn mark(&mut self, index: u32, mark: u32) {
        let said = &mut self.said[index as usize];
        if *said == 0 {
            self.marks.push([index, 0]);
        }
        *said |= ((mark | IS_MARKED) >> MARKS_AT) as u8;
    }

    pub fn discard(&mut self) {
        if let Some(len) = self.states.discard() {
            self.said.truncate(len);
            self.said.shrink_to_fit();
        }
    }
}

impl FilteredBoxes for Roster {
    fn states(&self) -> &BoxStates {
        &self.states
    }

    fn states_mut(&mut self) -> &mut BoxStates {
        &mut self.states
    }

    fn name(&mut self, index: u32) {
        self.mark(index, MARK_NAMES);
    }

    fn change(&mut self, index: u32) {
        self.mark(index, 0);
    }

    fn refilter(&mut self, index: u32) {
        self.mark(index, MARK_TOUCHES);
    }

    fn smaller(&self, [a, b]: [u32; 2]) -> u32 {
        // Sizes are not known here: a static box is often the larger one.
        if self.states.has(a, STILL) { b } else { a }
    }
}
