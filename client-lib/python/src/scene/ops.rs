//! What an edit does, collected until it is committed.

use std::sync::Arc;

use pairmask::filters::{FilterTable, Tag};
use pairmask::{Aabb, Margin, SceneEdit};
use pairmask_core::scene::{Indices, Margins};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::arrays::integers;

/// Indices of boxes.
pub enum Named {
    List(Vec<u32>),
    Range { first: u32, count: u32 },
}

impl Named {
    /// An index, a `range`, or a list or an array of indices or of truth values.
    pub fn of(given: &Bound<'_, PyAny>) -> PyResult<Self> {
        static INDICES: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let named = INDICES.import(given.py(), "pairmask._convert", "indices")?.call1((given,))?;
        if let Ok((first, count)) = named.extract() {
            return Ok(Self::Range { first, count });
        }
        Ok(Self::List(integers(&named, "uint32")?))
    }

    pub fn len(&self) -> usize {
        match self {
            Self::List(indices) => indices.len(),
            Self::Range { count, .. } => *count as usize,
        }
    }

    fn indices(&self) -> Indices<'_> {
        match self {
            Self::List(indices) => Indices::List(indices),
            Self::Range { first, count } => Indices::Range { first: *first, count: *count },
        }
    }
}

/// Margins of boxes that are set.
pub enum NamedMargins {
    Same(Margin),
    Each(Vec<Margin>),
}

impl NamedMargins {
    pub fn margins(&self) -> Margins<'_> {
        match self {
            Self::Same(margin) => (*margin).into(),
            Self::Each(margins) => margins.into(),
        }
    }
}

/// One call of an edit.
pub enum Op {
    Set(Named, Vec<Aabb>, Option<NamedMargins>),
    Remove(Named),
    Switch(Named, bool),
    Static(Named, bool),
    Tag(Named, Vec<Tag>),
    Filters(Arc<FilterTable>),
    Include(Vec<[u32; 2]>, bool),
    Exclude(Vec<[u32; 2]>, bool),
}

impl Op {
    /// Adds it to an edit.
    pub fn add_to<'s, 'a>(&'a self, edit: SceneEdit<'s, 'a>) -> SceneEdit<'s, 'a> {
        match self {
            Self::Set(named, boxes, None) => edit.set_all(named.indices(), boxes),
            Self::Set(named, boxes, Some(margins)) => {
                edit.set_all_margined(named.indices(), boxes, margins.margins())
            }
            Self::Remove(named) => edit.remove_all(named.indices()),
            Self::Switch(named, on) => edit.switch_all(named.indices(), *on),
            Self::Static(named, on) => edit.make_all_static(named.indices(), *on),
            Self::Tag(named, tags) => edit.tag_all(named.indices(), tags),
            Self::Filters(table) => edit.filters(table),
            Self::Include(pairs, on) => edit.include(pairs, *on),
            Self::Exclude(pairs, on) => edit.exclude(pairs, *on),
        }
    }
}
