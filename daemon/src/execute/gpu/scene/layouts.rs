//! The grid's levels for a scene whose boxes the host does not have: chosen by some of them, and kept.
//!
//! A layout only steers: with any, the same pairs are told.

use pairmask_core::Aabb;
use pairmask_shaders::layouts::{GridLayout, SceneSummary};

use super::plan::{Question, with_giants};
use crate::execute::gpu::grid::layout::Chooser;

/// Searches after which a layout is chosen anew, at most: to choose takes as long as a tenth of a search.
const RENEWED_AFTER: u32 = 64;
/// Boxes of an edit that are kept as a sample, at most.
const EDIT_SAMPLE: usize = 256;

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
    sample: Vec<Aabb>,
}

/// The layouts of a scene: one where few boxes are entries, one where all are.
#[derive(Default)]
pub(super) struct Layouts {
    chooser: Chooser,
    kinds: [Kind; 2],
    /// Some boxes of the last large edit.
    edited: Vec<Aabb>,
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
        if boxes.len() >= slots / 2 {
            // What was chosen before was chosen for other boxes, but hulls of entries are known better.
            for kind in &mut self.kinds {
                kind.sample.is_empty().then(|| kind.chosen = None);
            }
        }
    }

    /// The layout for a search.
    pub fn layout(&mut self, question: &Question) -> GridLayout {
        let boxes = question.grid_boxes();
        let kind = &mut self.kinds[usize::from(question.is_dense())];
        let fits = |chosen: &Chosen| {
            chosen.age < chosen.serves && chosen.boxes / 2 <= boxes && boxes / 2 <= chosen.boxes
        };
        let mut chosen = match kind.chosen.filter(fits) {
            Some(chosen) => chosen,
            None => {
                let serves = kind.chosen.map_or(1, |last| (2 * last.serves).min(RENEWED_AFTER));
                let sample = if kind.sample.is_empty() { &self.edited } else { &kind.sample };
                let layout = self.chooser.choose_for(sample.as_slice().into(), boxes);
                Chosen { layout, boxes, age: 0, serves }
            }
        };
        chosen.age += 1;
        kind.chosen = Some(chosen);
        with_giants(chosen.layout, question.slots)
    }

    /// Whether the next layout of this kind will be chosen anew, so that a sample is of use.
    fn wants_sample(&self, is_dense: bool) -> bool {
        let chosen = &self.kinds[usize::from(is_dense)].chosen;
        chosen.as_ref().is_none_or(|chosen| chosen.age >= chosen.serves)
    }

    /// Looks at the entries that a search had.
    pub fn note_search(&mut self, question: &Question, summary: &SceneSummary) {
        let is_dense = question.is_dense();
        if !self.wants_sample(is_dense) {
            return;
        }
        let count = (summary.sampled as usize).min(summary.samples.len());
        let sample = &mut self.kinds[usize::from(is_dense)].sample;
        sample.clear();
        sample.extend(
            summary.samples[..count].iter().map(|bits| Aabb::from(bits.map(f32::from_bits))),
        );
    }
}
