//! Sizes of a search: blocks, dispatches, and whether all boxes or few are its entries. Pure.
//!
//! The grid's levels for a scene whose boxes the host does not have are chosen by some of them, and kept. A layout only steers: with any, the same pairs are reported.

use pairmask_core::Aabb;
use pairmask_shaders::constants::{
    BATCH_BOXES, CONTROL_HEADER_WORDS, SCAN_CELLS, SUPERS_MOST, UNPLACED_A_CELL, WORD_BITS,
};
use pairmask_shaders::layouts::{GridLayout, SceneMode, SceneSummary};

use crate::execute::gpu::grid::layout::Chooser;

/// Boxes of a scene: names of entries have two bits beside the index.
pub(super) const MOST_SLOTS: u64 = 1 << 30;

/// Most workgroups of a stage: about two loads of a large GPU (132 multiprocessors of eight workgroups).
/// Each goes on with the next batch, so that dispatches need not follow the scene and are recorded once.
const MOST_GROUPS: u32 = 2_048;

/// Workgroups that sort pairs, at least.
const LEAST_ROW_GROUPS: u32 = 64;

/// Rows that a thread of `scene_pairs` looks at a time.
pub(super) const ROWS_TOGETHER: u64 = 4;

/// With more entries than one in so many boxes that collide, all boxes are entries: they find each other
/// by half the cells around them, and in order of place.
const DENSE_SHARE: u64 = 4;

/// Cells of a scene with few entries are that many anyway: 2 MiB, zeroed in no time, and few entries
/// share a cell that are far apart.
const FEW_CELLS: u64 = 512 << 10;

/// Cells for each entry or box, as the grid has.
const CELLS_A_BOX: u64 = 6;

/// Bits of the filter that an entry sets: three cells an axis.
const ENTRY_BITS: u64 = 27;
/// Bits of the filter for each that is set: so few boxes pass by chance.
const FILTER_SPARSITY: u64 = 8;
/// Words of the filter, at least and at most (16 MiB).
const FILTER_WORDS: (u64, u64) = (1 << 10, 1 << 22);

/// Entries that there is room for beyond those expected: wide boxes, and boxes that left their place.
const SPARE_ENTRIES: u64 = 1_024;
/// Bytes of an entry at its place, the larger one of its two forms, and of a found pair.
pub(super) const SORTED_BYTES: u64 = 32;
pub(super) const PAIR_BYTES: u64 = 8;
/// Room for found pairs, at least: 32 KiB.
const LEAST_PAIRS: u64 = 4_096;

/// Fewest rows of a share of a search: they take an H200 some 50 µs, and to wait for another GPU takes 10.
const SHARE_ROWS: u64 = 600_000;
/// An entry of a search takes as long as so many rows: it is placed, and looked for by others (an H200: 3 ns).
const ENTRY_ROWS: u64 = 40;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Question {
    pub mode: SceneMode,
    /// Indices that have a record.
    pub slots: u64,
    pub active: u64,
    /// Boxes that may have changed, or that the edit names; or queries that are entries.
    pub changed: u64,
}

impl Question {
    pub fn is_dense(&self) -> bool {
        match self.mode {
            SceneMode::All => true,
            SceneMode::Query => false,
            SceneMode::Changes | SceneMode::Moved => self.changed * DENSE_SHARE > self.active,
        }
    }

    pub fn entries(&self) -> u64 {
        if self.is_dense() { self.active.max(self.changed) } else { self.changed }
    }

    /// Items for which a search gets threads, where each takes so many rows beside the grid together. Where that is
    /// one, a thread gets one row or one entry at the most: a box that has moved far is two, and the last batches of
    /// both need not be full.
    pub fn elements(&self, rows_together: u64) -> u64 {
        let rows = if self.is_dense() { 0 } else { self.slots / rows_together };
        if rows_together == 1 {
            2 * self.entries() + rows + 2 * u64::from(BATCH_BOXES)
        } else {
            self.entries() + rows
        }
    }

    pub fn rows_a_thread(&self, rows_together: u64) -> u32 {
        let elements = self.elements(rows_together);
        let threads = u64::from(groups(elements)) * u64::from(BATCH_BOXES);
        elements.div_ceil(threads) as u32
    }

    /// How many of so many GPUs share the search: as many as have enough to do.
    pub fn shares(&self, gpus: usize) -> usize {
        let rows = self.slots + ENTRY_ROWS * self.entries();
        (rows / SHARE_ROWS).clamp(1, gpus.max(1) as u64) as usize
    }

    /// The number of boxes whose grid has as many cells as this search gets.
    pub fn grid_boxes(&self) -> u32 {
        let entries = self.entries();
        let cells = (CELLS_A_BOX * entries).max(FEW_CELLS).min(CELLS_A_BOX * self.slots);
        (cells / CELLS_A_BOX).clamp(1, MOST_SLOTS) as u32
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Room {
    pub entries: u64,
    pub pairs: u64,
}

impl Room {
    pub fn expected(question: &Question, last: Self) -> Self {
        let roomy = |count: u64| count + count / 4;
        let entries = roomy(question.entries()).max(roomy(last.entries)) + SPARE_ENTRIES;
        let pairs = roomy(last.pairs).max(LEAST_PAIRS);
        Self { entries: entries.min(2 * question.slots).max(1), pairs }
    }

    /// No more than stages of a device see: what is needed beyond is an error, and what is expected is none.
    pub fn within(self, binding_bytes: u64) -> Self {
        let entries = self.entries.min(binding_bytes / SORTED_BYTES);
        Self { entries, pairs: self.pairs.min(binding_bytes / PAIR_BYTES) }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sizes {
    pub sums: u32,
    pub table_words: u64,
    pub filter_words: u64,
    pub row_words: u64,
    pub control_words: u64,
    pub queries: u64,
}

impl Sizes {
    /// Of a search in a layout, with so many queries.
    pub fn of(question: &Question, layout: &GridLayout, queries: u64) -> Self {
        // The entry after the last cell holds the number of entries.
        let sums = (layout.cell_end + 1).div_ceil(SCAN_CELLS);
        let filter_words = if question.is_dense() {
            FILTER_WORDS.0
        } else {
            let bits = question.entries() * ENTRY_BITS * FILTER_SPARSITY;
            let words = (bits / u64::from(WORD_BITS)).next_power_of_two();
            words.clamp(FILTER_WORDS.0, FILTER_WORDS.1)
        };
        Self {
            sums,
            table_words: u64::from(sums) * u64::from(SCAN_CELLS),
            filter_words,
            row_words: question.slots.next_multiple_of(u64::from(BATCH_BOXES))
                / u64::from(WORD_BITS),
            control_words: u64::from(CONTROL_HEADER_WORDS + SUPERS_MOST + sums),
            queries,
        }
    }

    pub const fn table_bytes(&self) -> u64 {
        4 * (self.table_words + self.filter_words + self.row_words)
    }

    pub const fn zeroed_words(&self) -> u64 {
        self.table_words + self.filter_words
    }
}

/// A layout for so many indices: giants have cells by index, boxes that overlap nothing none.
pub(super) fn with_giants(mut layout: GridLayout, slots: u64) -> GridLayout {
    layout.first_nothing = layout.first_giant + (slots / u64::from(UNPLACED_A_CELL)) as u32 + 1;
    layout.cell_end = layout.first_nothing;
    layout
}

/// Workgroups for so many items: a power of two, so that few frames are recorded.
pub(super) fn groups(elements: u64) -> u32 {
    let groups = elements.div_ceil(u64::from(BATCH_BOXES)).next_power_of_two();
    groups.clamp(1, u64::from(MOST_GROUPS)) as u32
}

/// Workgroups that put the pairs of so many queries in order: some pairs a query, and never so few that a thread
/// has more to do than a software adapter does in a loop (65,535 rounds).
pub(super) fn groups_of_rows(queries: u64) -> u32 {
    groups(4 * queries).max(LEAST_ROW_GROUPS)
}

/// Searches after which a layout is chosen anew, at most: to choose takes as long as a tenth of a search.
const RENEWED_AFTER: u32 = 64;
const EDIT_SAMPLE: usize = 256;

/// Tests for each box that looks, from which another layout is tried.
const MANY_TESTS: u64 = 64;

#[derive(Clone, Copy, Debug)]
struct Chosen {
    layout: GridLayout,
    boxes: u32,
    age: u32,
    serves: u32,
}

#[derive(Default)]
struct Kind {
    chosen: Option<Chosen>,
    /// Some entries of a search.
    sample: Vec<Aabb>,
    /// The size of the grid that they were in.
    sampled_of: u32,
}

/// The layouts of a scene: one where few boxes are entries, one where all are, one where queries are.
#[derive(Default)]
pub(super) struct Layouts {
    chooser: Chooser,
    kinds: [Kind; 3],
    /// Some boxes of the last large edit.
    edited: Vec<Aabb>,
}

/// Whether two sizes of a scene are within a factor of two.
const fn are_alike(a: u32, b: u32) -> bool {
    a / 2 <= b && b / 2 <= a
}

fn kind_of(question: &Question) -> usize {
    match question.mode {
        SceneMode::Query => 2,
        _ => usize::from(question.is_dense()),
    }
}

impl Layouts {
    /// Looks at boxes that an edit sets, in a scene of so many.
    pub fn note_edit(&mut self, boxes: &[Aabb], slots: usize) {
        if boxes.is_empty() || (!self.edited.is_empty() && boxes.len() < slots / 2) {
            return;
        }
        let requested = boxes.len().min(EDIT_SAMPLE);
        let step = boxes.len() / requested;
        // Not at equal steps: scenes are often laid out in rows of some round number.
        let position = |i: usize| i * step + (i.wrapping_mul(0x9e37_79b9) >> 7) % step;
        self.edited.clear();
        self.edited.extend((0..requested).map(|i| boxes[position(i)]));
    }

    /// Looks at queries that are entries: a layout for them fits their sizes and those of the scene's boxes.
    pub fn note_queries(&mut self, question: &Question, queries: &[Aabb]) {
        let kind = &mut self.kinds[kind_of(question)];
        kind.sample.clear();
        let requested = queries.len().min(EDIT_SAMPLE);
        kind.sample.extend((0..requested).map(|i| queries[i * queries.len() / requested]));
        kind.sample.extend_from_slice(&self.edited);
        kind.sampled_of = question.grid_boxes();
    }

    pub fn layout(&mut self, question: &Question) -> GridLayout {
        let boxes = question.grid_boxes();
        let kind = &mut self.kinds[kind_of(question)];
        let last = kind.chosen.filter(|chosen| are_alike(chosen.boxes, boxes));
        let fits = |chosen: &Chosen| chosen.age < chosen.serves;
        let mut chosen = if let Some(chosen) = last.filter(fits) {
            chosen
        } else {
            let serves = last.map_or(1, |last| (2 * last.serves).min(RENEWED_AFTER));
            // Entries are hulls, which are larger than boxes; but the scene may be another now.
            let knows = !kind.sample.is_empty() && are_alike(kind.sampled_of, boxes);
            let sample = if knows || self.edited.is_empty() { &kind.sample } else { &self.edited };
            let layout = self.chooser.choose_for(sample.as_slice().into(), boxes);
            Chosen { layout, boxes, age: 0, serves }
        };
        chosen.age += 1;
        kind.chosen = Some(chosen);
        with_giants(chosen.layout, question.slots)
    }

    /// Looks at the entries that a search had, in which so many `looked` for others and `tested` so many.
    /// Whether the layout is a bad one for them, or the scene is crowded: another does not cost much then.
    pub fn note_search(
        &mut self,
        question: &Question,
        summary: &SceneSummary,
        looked: u64,
        tested: u64,
    ) -> bool {
        let kind = &mut self.kinds[kind_of(question)];
        let Some(chosen) = &mut kind.chosen else { return false };
        let is_bad = tested > MANY_TESTS * looked;
        if is_bad {
            chosen.age = chosen.serves;
        }
        // What queries are compared with is not among the entries: they have another sample.
        if chosen.age < chosen.serves || question.mode == SceneMode::Query {
            return is_bad;
        }
        let count = (summary.sampled as usize).min(summary.samples.len());
        let bits = summary.samples[..count].iter();
        kind.sample.clear();
        kind.sample.extend(bits.map(|bits| Aabb::from(bits.map(f32::from_bits))));
        kind.sampled_of = chosen.boxes;
        is_bad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::execute::gpu::grid::layout::cells_most;

    fn question(mode: SceneMode, slots: u64, changed: u64) -> Question {
        Question { mode, slots, active: slots, changed }
    }

    #[test]
    fn few_changes_are_looked_for_around_them_and_many_among_all() {
        let few = question(SceneMode::Changes, 1_000_000, 10_000);
        assert!(!few.is_dense() && few.entries() == 10_000);
        assert!(u64::from(few.grid_boxes()) * CELLS_A_BOX >= FEW_CELLS - CELLS_A_BOX);
        let many = question(SceneMode::Changes, 1_000_000, 300_000);
        assert!(many.is_dense() && many.entries() == 1_000_000);
        assert!(question(SceneMode::All, 10, 0).is_dense());
        assert!(!question(SceneMode::Query, 10, 1_000).is_dense());
        assert!(question(SceneMode::Moved, 0, 0).grid_boxes() == 1);
    }

    #[test]
    fn large_searches_are_shared_and_small_ones_are_not() {
        let shares =
            |slots, changed, gpus| question(SceneMode::Changes, slots, changed).shares(gpus);
        assert_eq!([shares(0, 0, 2), shares(1_000, 1_000, 2), shares(100_000, 1_000, 2)], [1; 3]);
        assert_eq!([shares(1_000_000, 100_000, 2), shares(10_000_000, 10, 2)], [2; 2]);
        assert_eq!([shares(10_000_000, 10, 1), shares(10_000_000, 10, 0)], [1; 2]);
        assert_eq!(shares(1_000_000, 20_000, 4), 3, "as many as have enough to do");
    }

    #[test]
    fn blocks_hold_every_cell_and_index() {
        for (slots, changed) in [(1, 1), (257, 3), (100_000, 1_000), (20_000_000, 20_000_000)] {
            let question = question(SceneMode::Changes, slots, changed);
            let layout =
                with_giants(GridLayout { first_giant: 77, ..GridLayout::default() }, slots);
            let sizes = Sizes::of(&question, &layout, 0);
            let most_cells =
                cells_most(question.grid_boxes()) + slots / u64::from(UNPLACED_A_CELL) + 1;
            assert!(sizes.table_words > u64::from(layout.cell_end));
            assert!(u64::from(layout.cell_end) < most_cells);
            assert!(u64::from(layout.first_giant) + (slots - 1) / 32 < u64::from(layout.cell_end));
            assert!(sizes.row_words * 32 >= slots && sizes.filter_words.is_power_of_two());
            assert!(sizes.zeroed_words().is_multiple_of(4));
            let room = Room::expected(&question, Room::default());
            assert!(room.entries >= changed.min(2 * slots) && room.entries <= 2 * slots);
        }
    }

    #[test]
    fn a_thread_gets_one_row_where_rows_are_limited() {
        let of = |mode, slots, changed| Question { mode, slots, active: slots, changed };
        for slots in [1, 255, 256, 700, 60_000, 200_000] {
            for question in [
                of(SceneMode::All, slots, 0),
                of(SceneMode::Changes, slots, 1),
                of(SceneMode::Changes, slots, slots / 5),
            ] {
                assert_eq!(question.rows_a_thread(1), 1, "{question:?}");
            }
        }
        assert_eq!(of(SceneMode::Changes, 1 << 20, 1).rows_a_thread(1), 3);
    }

    #[test]
    fn workgroups_are_powers_of_two() {
        let all = [0, 1, 256, 257, 1_000_000, 1 << 30].map(groups);
        assert_eq!(all, [1, 1, 1, 2, 2_048, 2_048]);
    }
}
