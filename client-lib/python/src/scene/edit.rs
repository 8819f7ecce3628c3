//! Edits: calls are collected, and committed as one.

use std::sync::{Mutex, PoisonError};

use pairmask::{Margin, Report};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::PyScene;
use super::answer::PySceneAnswer;
use super::ops::{Named, NamedMargins, Op};
use super::pending::PyPendingAnswer;
use crate::arrays;
use crate::errors::{Raise, misused};
use crate::rules::{Part, PyFilterTable, TagParts};
use crate::sources::Boxes;

/// An edit that is being written. Each call adds to it; `commit` or `submit` does all of it at once.
#[pyclass(frozen, name = "SceneEdit", module = "pairmask")]
pub struct PyEdit {
    scene: Py<PyScene>,
    /// `None` once it is committed or submitted.
    ops: Mutex<Option<Vec<Op>>>,
}

/// What an answer is asked to hold.
fn report_named(name: &str) -> PyResult<Report> {
    match name {
        "changes" => Ok(Report::Changes),
        "moved" => Ok(Report::Moved),
        "all" => Ok(Report::All),
        "nothing" => Ok(Report::Nothing),
        _ => Err(PyValueError::new_err(format!(
            "no answer '{name}': changes, moved, all or nothing"
        ))),
    }
}

impl PyEdit {
    pub const fn new(scene: Py<PyScene>) -> Self {
        Self { scene, ops: Mutex::new(Some(Vec::new())) }
    }

    fn add(&self, op: Op) -> PyResult<()> {
        let mut ops = self.ops.lock().unwrap_or_else(PoisonError::into_inner);
        ops.as_mut().map(|ops| ops.push(op)).ok_or_else(committed)
    }

    /// The steps, which are given once. They stay here while another edit of the scene is under way.
    fn take(&self, py: Python<'_>) -> PyResult<Vec<Op>> {
        self.scene.get().check_idle(py)?;
        self.ops.lock().unwrap_or_else(PoisonError::into_inner).take().ok_or_else(committed)
    }
}

fn committed() -> PyErr {
    misused("the edit was committed or submitted: begin another one", "Gone")
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
        let boxes = Boxes::of_some(boxes)?.to_vec(slf.py())?;
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

    /// Applies the edit and answers, while other Python threads run. The answer is acknowledged by that: what it
    /// reports is not reported again.
    #[pyo3(signature = (report="changes"))]
    fn commit(&self, py: Python<'_>, report: &str) -> PyResult<PySceneAnswer> {
        let report = report_named(report)?;
        let ops = self.take(py)?;
        PySceneAnswer::new(py, self.scene.get().commit(py, &ops, report)?)
    }

    /// Applies the edit and sends it. A daemon works on it while this thread does something else; in process it
    /// is answered before this returns.
    #[pyo3(signature = (report="changes"))]
    fn submit(&self, py: Python<'_>, report: &str) -> PyResult<PyPendingAnswer> {
        let report = report_named(report)?;
        let ops = self.take(py)?;
        let ticket = self.scene.get().submit(py, ops, report)?;
        Ok(PyPendingAnswer::new(self.scene.clone_ref(py), ticket))
    }
}
