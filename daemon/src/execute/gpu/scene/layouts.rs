//! The grid's levels for a scene whose boxes the host does not have: chosen by some of them, and kept.
//!
//! A layout only steers: with any, the same pairs are told.

use pairmask_core::Aabb;
use pairmask_shaders::layouts::{GridLayout, SceneMode, SceneSummary};

use super::plan::{Question, with_giants};
use crate::execute::gpu::grid::layout::Chooser;

/// Searches after which a layout is chosen anew, at most: to choose takes as long as a tenth of a search.
const RENEWED_AFTER: u32 = 64;
/// Boxes of an edit that are kept as a sample, at most.
const EDIT_SAMPLE: usize = 256;

/// Tests for each box that looks, from which another layout is tried.
const MANY_TESTS: u64 = 64;

/// A layout and how long it serves.
#[derive(Clone, Copy, Debug)]
struct Chosen {
    layout: GridLayout,
    boxes: u32,
    age: u32,
    serves: u32,
}

/// What is known of one kind of search.
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

/// The kind of a search.
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
        let wanted = boxes.len().min(EDIT_SAMPLE);
        let step = boxes.len() / wanted;
        // Not at equal steps: scenes are often laid out in rows of some round number.
        let place = |i: usize| i * step + (i.wrapping_mul(0x9e37_79b9) >> 7) % step;
        self.edited.clear();
        self.edited.extend((0..wanted).map(|i| boxes[place(i)]));
    }

    /// Looks at queries that are entries: a layout for them fits their sizes and those of the scene's boxes.
    pub fn note_queries(&mut self, question: &Question, queries: &[Aabb]) {
        let kind = &mut self.kinds[kind_of(question)];
        kind.sample.clear();
        let wanted = queries.len().min(EDIT_SAMPLE);
        kind.sample.extend((0..wanted).map(|i| queries[i * queries.len() / wanted]));
        kind.sample.extend_from_slice(&self.edited);
        kind.sampled_of = question.grid_boxes();
    }

    /// The layout for a search.
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
