//! What an edit does, collected until it is committed.

use std::sync::Arc;

use pairmask::filters::{FilterTable, Tag};
use pairmask::scene::{Indices, Margins, Sets, Step, Tags};
use pairmask::{Aabb, Margin};
use pyo3::exceptions::PyValueError;
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
    /// The step of an edit that does it.
    pub fn step(&self) -> Step<'_> {
        match self {
            Self::Set(named, boxes, _) => Step::Set(Sets { indices: named.indices(), boxes }),
            Self::Remove(named) => Step::Remove(named.indices()),
            Self::Switch(named, on) => Step::Switch(named.indices(), *on),
            Self::Static(named, on) => Step::Static(named.indices(), *on),
            Self::Tag(named, tags) => Step::Tag(Tags { indices: named.indices(), tags }),
            Self::Filters(table) => Step::Filters(table),
            Self::Include(pairs, on) => Step::Include(pairs, *on),
            Self::Exclude(pairs, on) => Step::Exclude(pairs, *on),
        }
    }

    /// Fails where a scene with margins does not know it.
    pub fn check_margined(&self) -> PyResult<()> {
        match self {
            Self::Set(_, _, None) => {
                Err(PyValueError::new_err("this scene's boxes have margins: set(…, margin=…)"))
            }
            Self::Set(..) | Self::Remove(_) | Self::Switch(..) | Self::Static(..) => Ok(()),
            _ => Err(PyValueError::new_err("a scene with margins has no tags, filters or lists")),
        }
    }

    /// Fails where a scene without margins does not know it.
    pub fn check_plain(&self) -> PyResult<()> {
        match self {
            Self::Set(_, _, Some(_)) => {
                Err(PyValueError::new_err("this scene's boxes have no margins"))
            }
            _ => Ok(()),
        }
    }
}

/// Adds steps to an edit with margins.
pub fn margined<'s, 'a>(
    edit: pairmask::MarginedEdit<'s, 'a>,
    op: &'a Op,
) -> pairmask::MarginedEdit<'s, 'a> {
    match op {
        Op::Set(named, boxes, Some(margins)) => {
            edit.set_all(named.indices(), boxes, margins.margins())
        }
        Op::Remove(named) => edit.remove_all(named.indices()),
        Op::Switch(named, on) => edit.switch_all(named.indices(), *on),
        Op::Static(named, on) => edit.make_all_static(named.indices(), *on),
        // Such steps were refused when they were given.
        _ => edit,
    }
}
