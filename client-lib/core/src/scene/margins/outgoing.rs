//! What of an edit is to be sent: boxes that have left what was sent of them.

use super::super::copy::SceneCopy;
use super::super::edit::Indices;
use super::super::replica::Replica;
use super::fit::{fits, to_send};
use super::{MarginedSets, Margins};
use crate::aabb::Aabb;
use crate::floats;
use crate::precision::Margin;
use crate::team::{self, Split, in_parts, part_count};

/// Boxes of a task, at least: fewer take less time than a task costs.
const TASK_BOXES: usize = 16_384;
/// A box that is held against its margin takes so long on one thread, ns.
const BOX_NS: f64 = 10.0;

/// Boxes to send, inflated, and their indices.
#[derive(Debug, Default)]
pub struct Outgoing {
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
}

impl Outgoing {
    /// Drops what was chosen.
    pub fn clear(&mut self) {
        self.indices.clear();
        self.boxes.clear();
    }

    /// Adds the boxes of `sets` that left what was `sent` of them, are new, or take the index of a box that
    /// the edit removes. `now` has checked the edit. With `all`, boxes that did not leave are added too, as
    /// they were sent.
    pub fn choose(
        &mut self,
        sets: &MarginedSets<'_>,
        now: &SceneCopy,
        sent: Replica<'_>,
        all: bool,
        threads: Option<usize>,
    ) {
        let part = Part(*sets);
        let choice = Choice { now, sent, all };
        let threads = team::threads_for(part.len() as f64 * BOX_NS, threads);
        let _team = team::enter(threads);
        let is_mask = matches!(sets.indices, Indices::Mask { .. });
        let parts = if is_mask { 1 } else { part_count(part.len(), TASK_BOXES, threads) };
        if parts == 1 {
            floats::with_default(|| part.choose(&choice, self));
            return;
        }
        let run = |part: Part<'_>| {
            let mut chosen = Self::default();
            part.choose(&choice, &mut chosen);
            chosen
        };
        let chosen = in_parts(part, parts, &run, &Self::with);
        self.indices.extend(chosen.indices);
        self.boxes.extend(chosen.boxes);
    }

    fn with(mut self, mut other: Self) -> Self {
        self.indices.append(&mut other.indices);
        self.boxes.append(&mut other.boxes);
        self
    }

    fn push(&mut self, index: u32, b: Aabb) {
        self.indices.push(index);
        self.boxes.push(b);
    }

    /// How many.
    pub const fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The indices: a range where they follow each other.
    pub fn indices(&self) -> Indices<'_> {
        match self.indices[..] {
            [first, ..] if self.indices.is_sorted_by(|a, b| a.checked_add(1) == Some(*b)) => {
                Indices::Range { first, count: self.indices.len() as u32 }
            }
            _ => Indices::List(&self.indices),
        }
    }

    /// A box for each.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Bytes that are allocated.
    pub const fn allocated_bytes(&self) -> usize {
        self.indices.capacity() * size_of::<u32>() + self.boxes.capacity() * size_of::<Aabb>()
    }
}

/// How boxes are chosen.
struct Choice<'a> {
    now: &'a SceneCopy,
    sent: Replica<'a>,
    all: bool,
}

impl Choice<'_> {
    #[inline]
    fn add(&self, to: &mut Outgoing, index: u32, b: &Aabb, margin: Margin) {
        let kept = self.sent.get(index).filter(|sent| fits(sent, b, margin));
        match kept.filter(|_| !self.now.is_removed_by_edit(index)) {
            None => to.push(index, to_send(b, margin)),
            Some(sent) if self.all => to.push(index, sent),
            Some(_) => {}
        }
    }
}

/// Some boxes of a step. Those of a bitmask are not split.
#[derive(Clone, Copy)]
struct Part<'a>(MarginedSets<'a>);

impl Part<'_> {
    fn choose(&self, choice: &Choice<'_>, to: &mut Outgoing) {
        let MarginedSets { indices, boxes, margins } = &self.0;
        indices.for_each(|at, index| choice.add(to, index, &boxes[at], margins.at(at)));
    }
}

impl Split for Part<'_> {
    fn len(&self) -> usize {
        self.0.boxes.len()
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let Self(MarginedSets { indices, boxes, margins }) = self;
        let (low, high) = boxes.split_at(at);
        let (low_indices, high_indices) = match indices {
            Indices::List(list) => {
                let (low, high) = list.split_at(at);
                (Indices::List(low), Indices::List(high))
            }
            Indices::Range { first, count } => {
                let middle = first + at as u32;
                let high = Indices::Range { first: middle, count: count - at as u32 };
                (Indices::from(first..middle), high)
            }
            mask @ Indices::Mask { .. } => (mask, Indices::List(&[])),
        };
        let (low_margins, high_margins) = match margins {
            Margins::Each(margins) => {
                let (low, high) = margins.split_at(at);
                (Margins::Each(low), Margins::Each(high))
            }
            same @ Margins::Same(_) => (same, same),
        };
        (
            Self(MarginedSets { indices: low_indices, boxes: low, margins: low_margins }),
            Self(MarginedSets { indices: high_indices, boxes: high, margins: high_margins }),
        )
    }
}
