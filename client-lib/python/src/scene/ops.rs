//! What an edit does, collected until it is committed.

use std::sync::Arc;

use pairmask::filters::{FilterData, FilterTable};
use pairmask::{Aabb, Margin, SceneEdit};
use pairmask_core::scene::Indices;
use pyo3::prelude::*;

use crate::arrays::numbers;
use crate::session::margin;

/// Indices of boxes: an index, a `range`, or a list or an array of indices or of truth values.
pub enum Named {
    List(Vec<u32>),
    Range { first: u32, count: u32 },
}

impl<'py> FromPyObject<'_, 'py> for Named {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let named = imported!(given.py(), "pairmask._convert", "indices")?.call1((given,))?;
        if let Ok((first, count)) = named.extract() {
            return Ok(Self::Range { first, count });
        }
        numbers(&named).map(Self::List)
    }
}

impl Named {
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

/// Margins of boxes that are set: a number for all, or one for each.
pub enum NamedMargins {
    Same(Margin),
    Each(Vec<Margin>),
}

impl<'py> FromPyObject<'_, 'py> for NamedMargins {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(units) = given.extract() {
            return margin(units).map(Self::Same);
        }
        let units: Vec<f32> = given.extract()?;
        units.into_iter().map(margin).collect::<PyResult<_>>().map(Self::Each)
    }
}

/// One call of an edit.
pub enum Op {
    Set(Named, Vec<Aabb>, Option<NamedMargins>),
    Remove(Named),
    Enable(Named, bool),
    Static(Named, bool),
    FilterData(Named, Vec<FilterData>),
    UserData(Named, Vec<u64>),
    Filters(Arc<FilterTable>),
    Include(Vec<[u32; 2]>, bool),
    Exclude(Vec<[u32; 2]>, bool),
}

impl Op {
    /// Adds it to an edit.
    pub fn add_to<'s, 'a>(&'a self, edit: SceneEdit<'s, 'a>) -> SceneEdit<'s, 'a> {
        match self {
            Self::Set(named, boxes, None) => edit.set_all(named.indices(), boxes),
            Self::Set(named, boxes, Some(NamedMargins::Same(margin))) => {
                edit.set_all_margined(named.indices(), boxes, *margin)
            }
            Self::Set(named, boxes, Some(NamedMargins::Each(margins))) => {
                edit.set_all_margined(named.indices(), boxes, margins)
            }
            Self::Remove(named) => edit.remove_all(named.indices()),
            Self::Enable(named, on) => edit.set_all_enabled(named.indices(), *on),
            Self::Static(named, on) => edit.make_all_static(named.indices(), *on),
            Self::FilterData(named, filter_data) => {
                edit.set_all_filters(named.indices(), filter_data)
            }
            Self::UserData(named, user_data) => edit.set_all_user_data(named.indices(), user_data),
            Self::Filters(table) => edit.filter_table(table),
            Self::Include(pairs, on) => edit.include(pairs, *on),
            Self::Exclude(pairs, on) => edit.exclude(pairs, *on),
        }
    }
}
