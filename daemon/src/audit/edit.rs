//! An edit, copied.

use pairmask_core::aabb::Aabb;
use pairmask_core::filters::{FilterTable, Tag};
use pairmask_core::scene::{Edit, Indices, Sets, Step, Tags};

/// The steps of an edit.
#[derive(Debug)]
pub(super) struct OwnedEdit(Vec<OwnedStep>);

/// As [`Step`].
#[derive(Debug)]
enum OwnedStep {
    Remove(OwnedIndices),
    Set(OwnedIndices, Vec<Aabb>),
    Switch(OwnedIndices, bool),
    Static(OwnedIndices, bool),
    Tag(OwnedIndices, Vec<Tag>),
    Filters(FilterTable),
    Include(Vec<[u32; 2]>, bool),
    Exclude(Vec<[u32; 2]>, bool),
}

/// As [`Indices`].
#[derive(Debug)]
enum OwnedIndices {
    List(Vec<u32>),
    Range { first: u32, count: u32 },
    Mask { first: u32, words: Vec<u32> },
}

impl OwnedEdit {
    /// Copies an edit. `None` where it has a step of a later core.
    pub fn of(edit: Edit<'_>) -> Option<Self> {
        edit.steps.iter().map(OwnedStep::of).collect::<Option<_>>().map(Self)
    }

    /// Its steps.
    pub fn steps(&self) -> Vec<Step<'_>> {
        self.0.iter().map(OwnedStep::step).collect()
    }
}

impl OwnedStep {
    fn of(step: &Step<'_>) -> Option<Self> {
        let indices = OwnedIndices::of;
        Some(match *step {
            Step::Remove(of) => Self::Remove(indices(of)?),
            Step::Set(sets) => Self::Set(indices(sets.indices)?, sets.boxes.to_vec()),
            Step::Switch(of, is_on) => Self::Switch(indices(of)?, is_on),
            Step::Static(of, is_static) => Self::Static(indices(of)?, is_static),
            Step::Tag(tags) => Self::Tag(indices(tags.indices)?, tags.tags.to_vec()),
            Step::Filters(table) => Self::Filters(table.clone()),
            Step::Include(pairs, is_on) => Self::Include(pairs.to_vec(), is_on),
            Step::Exclude(pairs, is_on) => Self::Exclude(pairs.to_vec(), is_on),
            _ => return None,
        })
    }

    fn step(&self) -> Step<'_> {
        match self {
            Self::Remove(of) => Step::Remove(of.indices()),
            Self::Set(of, boxes) => Step::Set(Sets { indices: of.indices(), boxes }),
            Self::Switch(of, is_on) => Step::Switch(of.indices(), *is_on),
            Self::Static(of, is_static) => Step::Static(of.indices(), *is_static),
            Self::Tag(of, tags) => Step::Tag(Tags { indices: of.indices(), tags }),
            Self::Filters(table) => Step::Filters(table),
            Self::Include(pairs, is_on) => Step::Include(pairs, *is_on),
            Self::Exclude(pairs, is_on) => Step::Exclude(pairs, *is_on),
        }
    }
}

impl OwnedIndices {
    fn of(indices: Indices<'_>) -> Option<Self> {
        Some(match indices {
            Indices::List(list) => Self::List(list.to_vec()),
            Indices::Range { first, count } => Self::Range { first, count },
            Indices::Mask { first, words } => Self::Mask { first, words: words.to_vec() },
            _ => return None,
        })
    }

    fn indices(&self) -> Indices<'_> {
        match self {
            Self::List(list) => Indices::List(list),
            Self::Range { first, count } => Indices::Range { first: *first, count: *count },
            Self::Mask { first, words } => Indices::Mask { first: *first, words },
        }
    }
}
