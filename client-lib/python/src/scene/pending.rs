//! Edits under way.

use std::sync::atomic::{AtomicBool, Ordering};

use pyo3::prelude::*;

use super::PyScene;
use super::answer::PySceneAnswer;
use super::edited::Ticket;

/// An edit under way. Dropped, it is applied, and its answer counts as never given.
#[pyclass(frozen, name = "PendingAnswer", module = "pairmask")]
pub struct PyPendingAnswer {
    scene: Py<PyScene>,
    ticket: Ticket,
    /// Whether the answer is neither waited for nor given up.
    is_open: AtomicBool,
}

impl PyPendingAnswer {
    pub const fn new(scene: Py<PyScene>, ticket: Ticket) -> Self {
        Self { scene, ticket, is_open: AtomicBool::new(true) }
    }

    fn leave(&self) {
        // Relaxed: the scene's lock orders all else.
        if self.is_open.swap(false, Ordering::Relaxed) {
            self.scene.get().leave(self.ticket);
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
    fn wait(&self, py: Python<'_>) -> PyResult<PySceneAnswer> {
        let reported = self.scene.get().wait(py, self.ticket);
        self.is_open.store(false, Ordering::Relaxed);
        PySceneAnswer::new(py, reported?)
    }

    /// Gives the answer up, if it was not waited for: the edit is applied, and the next answer makes up for
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
