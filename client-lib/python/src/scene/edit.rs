//! Edits: calls are collected, and committed as one.

use std::sync::{Mutex, PoisonError};

use pairmask::scene::Want;
use pairmask::{Aabb, Margin, MarginedAnswer, SceneAnswer, ServedBy, SharedAnswer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::answer::{PySceneAnswer, Read, read};
use super::ops::{Named, NamedMargins, Op, margined};
use super::{PyMarginedScene, PyScene, PySharedScene};
use crate::arrays::{self, Rows};
use crate::errors::{Raise, misused};
use crate::rules::{Part, PyFilterTable, TagParts};

/// The scene that an edit changes.
pub enum Target {
    Plain(Py<PyScene>),
    Margined(Py<PyMarginedScene>),
    Shared(Py<PySharedScene>),
}

/// An edit that is being written. Each call adds to it; `commit` does all of it at once.
#[pyclass(frozen, name = "SceneEdit", module = "pairmask")]
pub struct PyEdit {
    target: Target,
    /// `None` once it is committed.
    ops: Mutex<Option<Vec<Op>>>,
}

/// What an answer is asked to hold.
fn want_named(name: &str) -> PyResult<Want> {
    match name {
        "changes" => Ok(Want::Changes),
        "moved" => Ok(Want::Moved),
        "all" => Ok(Want::All),
        "nothing" => Ok(Want::Nothing),
        _ => Err(PyValueError::new_err(format!(
            "no answer '{name}': changes, moved, all or nothing"
        ))),
    }
}

impl PyEdit {
    pub const fn new(target: Target) -> Self {
        Self { target, ops: Mutex::new(Some(Vec::new())) }
    }

    fn add(&self, op: Op) -> PyResult<()> {
        match &self.target {
            Target::Margined(_) => op.check_margined()?,
            Target::Plain(_) | Target::Shared(_) => op.check_plain()?,
        }
        let mut ops = self.ops.lock().unwrap_or_else(PoisonError::into_inner);
        ops.as_mut().map(|ops| ops.push(op)).ok_or_else(committed)
    }
}

fn committed() -> PyErr {
    misused("the edit was committed: begin another one", "Gone")
}

/// Margins of so many boxes: a number for all, or one for each.
fn margins_of(given: &Bound<'_, PyAny>) -> PyResult<NamedMargins> {
    if let Ok(units) = given.extract::<f32>() {
        return Ok(NamedMargins::Same(Margin::new(units).map_err(Raise::raise)?));
    }
    let units: Vec<f32> = given.extract()?;
    let margins: Result<Vec<Margin>, _> = units.into_iter().map(Margin::new).collect();
    Ok(NamedMargins::Each(margins.map_err(Raise::raise)?))
}

#[pymethods]
impl PyEdit {
    /// Sets boxes; inserts those that are absent.
    #[pyo3(signature = (indices, boxes, margin=None))]
    fn set<'py>(
        slf: Bound<'py, Self>,
        indices: &Bound<'py, PyAny>,
        boxes: &Bound<'py, PyAny>,
        margin: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, Self>> {
        let named = Named::of(indices)?;
        let boxes: Vec<Aabb> = Rows::of_some(boxes, 6)?.boxes(slf.py())?;
        let margins = margin.map(margins_of).transpose()?;
        slf.get().add(Op::Set(named, boxes, margins))?;
        Ok(slf)
    }

    /// Removes boxes.
    fn remove<'py>(
        slf: Bound<'py, Self>,
        indices: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, Self>> {
        slf.get().add(Op::Remove(Named::of(indices)?))?;
        Ok(slf)
    }

    /// Switches boxes off (they overlap nothing) or on.
    #[pyo3(signature = (indices, on))]
    fn switch<'py>(
        slf: Bound<'py, Self>,
        indices: &Bound<'py, PyAny>,
        on: bool,
    ) -> PyResult<Bound<'py, Self>> {
        slf.get().add(Op::Switch(Named::of(indices)?, on))?;
        Ok(slf)
    }

    /// Makes boxes static (two static boxes are no pair) or not.
    #[pyo3(signature = (indices, is_static=true))]
    fn make_static<'py>(
        slf: Bound<'py, Self>,
        indices: &Bound<'py, PyAny>,
        is_static: bool,
    ) -> PyResult<Bound<'py, Self>> {
        slf.get().add(Op::Static(Named::of(indices)?, is_static))?;
        Ok(slf)
    }

    /// Gives boxes their tags. What is not named becomes what a box without a tag has.
    #[pyo3(signature = (indices, *, world=None, owner=None, filter=None, is_static=None))]
    fn tag<'py>(
        slf: Bound<'py, Self>,
        indices: &Bound<'py, PyAny>,
        world: Part<'_, 'py>,
        owner: Part<'_, 'py>,
        filter: Part<'_, 'py>,
        is_static: Part<'_, 'py>,
    ) -> PyResult<Bound<'py, Self>> {
        let named = Named::of(indices)?;
        let tags = TagParts { world, owner, filter, is_static }.tags(named.len())?;
        slf.get().add(Op::Tag(named, tags))?;
        Ok(slf)
    }

    /// The filters that tags name, in place of all before.
    fn filters<'py>(slf: Bound<'py, Self>, table: &PyFilterTable) -> PyResult<Bound<'py, Self>> {
        slf.get().add(Op::Filters(table.shared()))?;
        Ok(slf)
    }

    /// Puts pairs on the include list, or takes them off.
    #[pyo3(signature = (pairs, on=true))]
    fn include<'py>(
        slf: Bound<'py, Self>,
        pairs: &Bound<'py, PyAny>,
        on: bool,
    ) -> PyResult<Bound<'py, Self>> {
        slf.get().add(Op::Include(arrays::pairs(pairs)?, on))?;
        Ok(slf)
    }

    /// Puts pairs on the exclude list, or takes them off.
    #[pyo3(signature = (pairs, on=true))]
    fn exclude<'py>(
        slf: Bound<'py, Self>,
        pairs: &Bound<'py, PyAny>,
        on: bool,
    ) -> PyResult<Bound<'py, Self>> {
        slf.get().add(Op::Exclude(arrays::pairs(pairs)?, on))?;
        Ok(slf)
    }

    /// Applies the edit and answers, while other Python threads run. An answer that is not taken counts as
    /// never given: the next one makes up for it.
    #[pyo3(signature = (want="changes", *, take=true))]
    fn commit(&self, py: Python<'_>, want: &str, take: bool) -> PyResult<PySceneAnswer> {
        let want = want_named(want)?;
        let ops = self.ops.lock().unwrap_or_else(PoisonError::into_inner).take();
        let ops = &ops.ok_or_else(committed)?[..];
        let read = match &self.target {
            Target::Plain(scene) => scene.get().commit(py, ops, want, take),
            Target::Margined(scene) => scene.get().commit(py, ops, want, take),
            Target::Shared(scene) => scene.get().commit(py, ops, want, take),
        };
        PySceneAnswer::new(py, read?)
    }
}

impl PyScene {
    fn commit(&self, py: Python<'_>, ops: &[Op], want: Want, take: bool) -> PyResult<Read> {
        let served_by = |answer: &SceneAnswer<'_>| Some(answer.served_by().as_str());
        let committed = self.scene.with_detached(py, |scene| {
            let edit = ops.iter().fold(scene.edit(), |edit, op| edit.step(op.step()));
            let answer = edit.commit(want)?;
            let answer = if take { answer.take() } else { answer };
            Ok(read!(answer, served_by, |_: &_| None, |_: &_| Vec::new()))
        });
        committed?.map_err(|error: pairmask::CommitError| error.raise())
    }
}

impl PyMarginedScene {
    fn commit(&self, py: Python<'_>, ops: &[Op], want: Want, take: bool) -> PyResult<Read> {
        let served_by = |answer: &MarginedAnswer<'_>| answer.served_by().map(ServedBy::as_str);
        let committed = self.scene.with_detached(py, |scene| {
            let answer = ops.iter().fold(scene.edit(), margined).commit(want)?;
            let answer = if take { answer.take() } else { answer };
            Ok(read!(answer, served_by, |_: &_| None, |_: &_| Vec::new()))
        });
        committed?.map_err(|error: pairmask::CommitError| error.raise())
    }
}

impl PySharedScene {
    fn commit(&self, py: Python<'_>, ops: &[Op], want: Want, take: bool) -> PyResult<Read> {
        let served_by = |_: &SharedAnswer<'_>| Some(ServedBy::Daemon.as_str());
        let committed = self.scene.with_detached(py, |scene| {
            let edit = ops.iter().fold(scene.edit(), |edit, op| edit.step(op.step()));
            let answer = edit.commit(want)?;
            let answer = if take { answer.take() } else { answer };
            let tick = |answer: &SharedAnswer<'_>| Some(answer.tick());
            Ok(read!(answer, served_by, tick, SharedAnswer::late))
        });
        committed?.map_err(|error: pairmask::SharedError| error.raise())
    }
}
