//! Edits: calls are collected, and committed as one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use pairmask::Report;
use pyo3::prelude::*;

use super::edited::{Edited, Ticket};
use super::ops::{Named, NamedMargins, Op};
use crate::arrays::{Pairs, Rows, numbers};
use crate::guarded::Guarded;
use crate::rules::{Part, PyFilterTable, filter_data};
use crate::session::one_of;

/// An edit that is being written. Each call adds to it; `commit` or `submit` does all of it at once.
#[pyclass(frozen, name = "SceneEdit", module = "pairmask")]
pub struct PyEdit {
    scene: Arc<Guarded<Edited>>,
    ops: Guarded<Vec<Op>>,
}

/// An edit with one more call.
type Added<'py> = PyResult<Bound<'py, PyEdit>>;

fn add(edit: Bound<'_, PyEdit>, op: Op) -> Added<'_> {
    edit.get().ops.with(edit.py(), |ops| ops.push(op))?;
    Ok(edit)
}

impl PyEdit {
    pub const fn new(scene: Arc<Guarded<Edited>>) -> Self {
        let text = "the edit was committed or submitted: begin another one";
        Self { scene, ops: Guarded::new(Vec::new(), text) }
    }

    /// What an answer is asked to hold, and the steps, which are given once. They stay here while another edit of
    /// the scene is under way.
    fn take(&self, py: Python<'_>, report: &str) -> PyResult<(Vec<Op>, Report)> {
        let known = [
            ("changes", Report::Changes),
            ("moved", Report::Moved),
            ("all", Report::All),
            ("nothing", Report::Nothing),
        ];
        let report = one_of(report, &known)?;
        self.scene.with(py, |edited| edited.scene().map(drop))??;
        Ok((self.ops.take(py)?, report))
    }
}

#[pymethods]
impl PyEdit {
    /// Sets boxes (n, 6); inserts those that are absent. `margin` is a number for all, or one for each (n).
    #[pyo3(signature = (indices, boxes, margin=None))]
    fn set(
        slf: Bound<'_, Self>,
        indices: Named,
        boxes: Rows,
        margin: Option<NamedMargins>,
    ) -> Added<'_> {
        let boxes = boxes.boxes(slf.py())?;
        add(slf, Op::Set(indices, boxes, margin))
    }

    /// Removes boxes.
    fn remove(slf: Bound<'_, Self>, indices: Named) -> Added<'_> {
        add(slf, Op::Remove(indices))
    }

    /// Disables boxes (they overlap nothing) with `on` false, else enables them.
    fn set_enabled(slf: Bound<'_, Self>, indices: Named, on: bool) -> Added<'_> {
        add(slf, Op::Enable(indices, on))
    }

    /// Makes boxes static (two static boxes are no pair) or not.
    #[pyo3(signature = (indices, is_static=true))]
    fn make_static(slf: Bound<'_, Self>, indices: Named, is_static: bool) -> Added<'_> {
        add(slf, Op::Static(indices, is_static))
    }

    /// Gives boxes their filter data, a number for all or one for each (n). What is not named becomes what a box without
    /// filter data has.
    #[pyo3(signature = (indices, *, world=None, owner=None, filter=None, is_static=None))]
    fn set_filter<'py>(
        slf: Bound<'py, Self>,
        indices: Named,
        world: Part<'_, 'py>,
        owner: Part<'_, 'py>,
        filter: Part<'_, 'py>,
        is_static: Part<'_, 'py>,
    ) -> Added<'py> {
        let filter_data =
            filter_data(slf.py(), Some(indices.len()), [world, owner, filter, is_static])?;
        add(slf, Op::FilterData(indices, filter_data))
    }

    /// Gives boxes user data, a number for all or one for each (n): integers of 64 bits, which change nothing that is
    /// reported.
    fn set_user_data<'py>(
        slf: Bound<'py, Self>,
        indices: Named,
        user_data: &Bound<'_, PyAny>,
    ) -> Added<'py> {
        let given = imported!(slf.py(), "pairmask._convert", "user_data")?;
        let user_data = numbers(&given.call1((user_data, indices.len()))?)?;
        add(slf, Op::UserData(indices, user_data))
    }

    /// The filters that filter data names, in place of all before.
    fn filter_table<'py>(slf: Bound<'py, Self>, table: &PyFilterTable) -> Added<'py> {
        add(slf, Op::Filters(Arc::clone(&table.0)))
    }

    /// Adds pairs (n, 2) to the include list, or removes them from it.
    #[pyo3(signature = (pairs, on=true))]
    fn include(slf: Bound<'_, Self>, pairs: Pairs, on: bool) -> Added<'_> {
        add(slf, Op::Include(pairs.0, on))
    }

    /// Adds pairs (n, 2) to the exclude list, or removes them from it.
    #[pyo3(signature = (pairs, on=true))]
    fn exclude(slf: Bound<'_, Self>, pairs: Pairs, on: bool) -> Added<'_> {
        add(slf, Op::Exclude(pairs.0, on))
    }

    /// Applies the edit and answers, while other Python threads run. The answer is acknowledged by that: what it
    /// reports is not reported again.
    #[pyo3(signature = (report="changes"))]
    fn commit<'py>(&self, py: Python<'py>, report: &str) -> PyResult<Bound<'py, PyAny>> {
        let (ops, report) = self.take(py, report)?;
        let read = self.scene.with_detached(py, |edited| edited.commit(ops, report))??;
        read.into_python(py)
    }

    /// Applies the edit and sends it. A daemon works on it while this thread does something else; in process it
    /// is answered before this returns.
    #[pyo3(signature = (report="changes"))]
    fn submit(&self, py: Python<'_>, report: &str) -> PyResult<PyPendingAnswer> {
        let (ops, report) = self.take(py, report)?;
        let ticket = self.scene.with_detached(py, |edited| edited.submit(ops, report))??;
        let scene = Arc::clone(&self.scene);
        Ok(PyPendingAnswer { scene, ticket, is_open: AtomicBool::new(true) })
    }
}

/// An edit under way. Dropped, it is applied, and its answer is discarded.
#[pyclass(frozen, name = "PendingAnswer", module = "pairmask")]
pub struct PyPendingAnswer {
    scene: Arc<Guarded<Edited>>,
    ticket: Ticket,
    /// Whether the answer is neither received nor discarded.
    is_open: AtomicBool,
}

impl PyPendingAnswer {
    fn leave(&self) {
        // Relaxed: the scene's lock orders all else.
        if self.is_open.swap(false, Ordering::Relaxed) {
            self.scene.with_rest(|edited| edited.leave(self.ticket));
        }
    }
}

impl Drop for PyPendingAnswer {
    fn drop(&mut self) {
        self.leave();
    }
}

#[pymethods]
impl PyPendingAnswer {
    /// Waits for the answer, while other Python threads run. It is acknowledged by that.
    fn wait<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let read = self.scene.with_detached(py, |edited| edited.wait(self.ticket));
        self.is_open.store(false, Ordering::Relaxed);
        read??.into_python(py)
    }

    /// Discards the answer, if it was not waited for: the edit is applied, and the next answer makes up for
    /// this one.
    fn close(&self, py: Python<'_>) {
        // Another thread may be waiting for it.
        py.detach(|| self.leave());
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) {
        self.close(py);
    }
}
