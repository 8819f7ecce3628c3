//! Frames being filled: memory that numpy arrays lie over until the frame is submitted.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pairmask::{BoxCount, Frame, FrameError, NarrowFrame, PendingFrame, SphereFrame};
use pyo3::PyClass;
use pyo3::exceptions::{PyBufferError, PyValueError};
use pyo3::prelude::*;
use pyo3::pyclass_init::PyClassInitializer;

use crate::arrays::{Rows, check_len};
use crate::errors::{Raise, misused};
use crate::guarded::Guarded;
use crate::memory::{Memory, Number};
use crate::pairs::PyPairMask;
use crate::process;
use crate::rules::PyRules;
use crate::sources::Boxes;

/// A frame until it is submitted, and how many arrays lie over it.
struct Filling<F> {
    /// `None` once it is submitted.
    frame: Option<F>,
    views: usize,
}

/// A frame that arrays may lie over. While any does, the frame is neither written nor submitted: an array
/// would then read or write memory that another process works on.
struct Viewed<F> {
    filling: Arc<Mutex<Filling<F>>>,
}

/// Keeps a frame's memory where it is, for an array.
struct View<F> {
    filling: Arc<Mutex<Filling<F>>>,
}

impl<F> Drop for View<F> {
    fn drop(&mut self) {
        self.filling.lock().unwrap_or_else(PoisonError::into_inner).views -= 1;
    }
}

impl<F: Send + 'static> Viewed<F> {
    fn new(frame: F) -> Self {
        Self { filling: Arc::new(Mutex::new(Filling { frame: Some(frame), views: 0 })) }
    }

    /// A new array over the frame's memory. The lock is never held for long: nothing waits under it.
    fn view<'py, T: Number, const N: usize>(
        &self,
        py: Python<'py>,
        rows: impl FnOnce(&mut F) -> &mut [[T; N]],
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        let memory = {
            let Filling { frame, views } = &mut *filling;
            let frame = frame.as_mut().ok_or_else(gone)?;
            *views += 1;
            let view = View { filling: Arc::clone(&self.filling) };
            Memory::of_writable(rows(frame), Box::new(view))
        };
        drop(filling);
        memory.into_array(py)
    }

    /// Calls `f` with the frame where no array lies over it.
    fn with<R>(&self, f: impl FnOnce(&mut F) -> R) -> PyResult<R> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        filling.check()?;
        filling.frame.as_mut().map(f).ok_or_else(gone)
    }

    /// The frame, where no array lies over it.
    fn take(&self) -> PyResult<F> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        filling.check()?;
        filling.frame.take().ok_or_else(gone)
    }

    /// Submits the frame while other Python threads run: in process, the pairs are found meanwhile.
    fn submit(
        &self,
        py: Python<'_>,
        submit: impl FnOnce(F) -> Result<PendingFrame, FrameError> + Send,
    ) -> PyResult<PyPendingFrame> {
        process::check()?;
        let frame = self.take()?;
        py.detach(|| submit(frame)).map(PyPendingFrame::new).map_err(Raise::raise)
    }
}

impl<F> Drop for Filling<F> {
    fn drop(&mut self) {
        process::drop_here(self.frame.take());
    }
}

impl<F> Filling<F> {
    fn check(&self) -> PyResult<()> {
        if self.views == 0 || self.frame.is_none() {
            return Ok(());
        }
        Err(PyBufferError::new_err(format!(
            "{} arrays lie over this frame's memory: drop them (del) before it is written as a whole or submitted",
            self.views
        )))
    }
}

fn gone() -> PyErr {
    misused("the frame was submitted", "Gone")
}

/// What frames of all kinds have. Their classes are derived from it.
#[pyclass(frozen, subclass, name = "_AnyFrame", module = "pairmask")]
pub struct PyAnyFrame {
    n: usize,
    is_shared: bool,
}

impl PyAnyFrame {
    /// A frame as an object of its own class.
    fn of_class<C: PyClass<BaseType = Self>>(self, py: Python<'_>, class: C) -> PyResult<Py<C>> {
        Py::new(py, PyClassInitializer::from(self).add_subclass(class))
    }
}

#[pymethods]
impl PyAnyFrame {
    /// Boxes or spheres in this frame.
    #[getter]
    fn n(&self) -> usize {
        self.n
    }

    fn __len__(&self) -> usize {
        self.n
    }

    /// Whether they lie in shared memory.
    #[getter]
    fn is_shared(&self) -> bool {
        self.is_shared
    }
}

/// Memory for the boxes of one frame.
#[pyclass(frozen, extends = PyAnyFrame, name = "Frame", module = "pairmask")]
pub struct PyFrame {
    viewed: Viewed<Frame>,
}

impl PyFrame {
    pub fn new(py: Python<'_>, frame: Frame) -> PyResult<Py<Self>> {
        let any = PyAnyFrame { n: frame.n().len(), is_shared: frame.is_shared() };
        any.of_class(py, Self { viewed: Viewed::new(frame) })
    }
}

#[pymethods]
impl PyFrame {
    /// The boxes as a new array over the frame's memory, contents unspecified until written.
    #[getter]
    fn boxes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.viewed.view(py, Frame::raw_mut)
    }

    /// Writes every box.
    fn write(&self, py: Python<'_>, boxes: &Bound<'_, PyAny>) -> PyResult<()> {
        let boxes = Boxes::of(boxes)?;
        self.viewed.with(|frame| boxes.write(py, frame.boxes_mut()))?
    }

    /// Asks for the pairs.
    fn submit(&self, py: Python<'_>) -> PyResult<PyPendingFrame> {
        self.viewed.submit(py, Frame::submit)
    }

    /// Asks for the pairs of two sets: the first `first` boxes against all others.
    fn submit_between(&self, py: Python<'_>, first: u32) -> PyResult<PyPendingFrame> {
        self.viewed.submit(py, move |frame| frame.submit_between(BoxCount::new(first)))
    }

    /// Asks for the pairs that rules let meet.
    fn submit_with(&self, py: Python<'_>, rules: &PyRules) -> PyResult<PyPendingFrame> {
        let rules = rules.shared();
        self.viewed.submit(py, move |frame| frame.submit_with(&rules))
    }

    /// As `submit_with`, for rules that stay: a daemon is sent them once.
    fn submit_with_kept(&self, py: Python<'_>, rules: &PyRules) -> PyResult<PyPendingFrame> {
        let rules = rules.shared();
        self.viewed.submit(py, move |frame| frame.submit_with_kept(&rules))
    }
}

/// Memory for the spheres of one frame.
#[pyclass(frozen, extends = PyAnyFrame, name = "SphereFrame", module = "pairmask")]
pub struct PySphereFrame {
    viewed: Viewed<SphereFrame>,
}

impl PySphereFrame {
    pub fn new(py: Python<'_>, frame: SphereFrame) -> PyResult<Py<Self>> {
        let any = PyAnyFrame { n: frame.n().len(), is_shared: frame.is_shared() };
        any.of_class(py, Self { viewed: Viewed::new(frame) })
    }
}

#[pymethods]
impl PySphereFrame {
    /// The spheres as a new array over the frame's memory, `x y z radius` a row.
    #[getter]
    fn spheres<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.viewed.view(py, SphereFrame::raw_mut)
    }

    /// Writes every sphere.
    fn write(&self, py: Python<'_>, spheres: &Bound<'_, PyAny>) -> PyResult<()> {
        let rows = Rows::of(spheres, 4)?;
        self.viewed.with(|frame| rows.write_spheres(py, frame.spheres_mut()))?
    }

    /// Asks for the pairs.
    fn submit(&self, py: Python<'_>) -> PyResult<PyPendingFrame> {
        self.viewed.submit(py, SphereFrame::submit)
    }
}

/// Memory for the boxes of one frame in a narrow form. No array lies over it: `write` rounds the boxes.
#[pyclass(frozen, extends = PyAnyFrame, name = "NarrowFrame", module = "pairmask")]
pub struct PyNarrowFrame {
    viewed: Viewed<NarrowFrame>,
}

impl PyNarrowFrame {
    pub fn new(py: Python<'_>, frame: NarrowFrame) -> PyResult<Py<Self>> {
        let any = PyAnyFrame { n: frame.n().len(), is_shared: frame.is_shared() };
        any.of_class(py, Self { viewed: Viewed::new(frame) })
    }
}

#[pymethods]
impl PyNarrowFrame {
    /// Writes every box in the frame's form.
    fn write(&self, py: Python<'_>, boxes: &Bound<'_, PyAny>) -> PyResult<()> {
        let boxes = Boxes::of(boxes)?.to_vec(py)?;
        py.detach(|| {
            self.viewed.with(|frame| {
                check_len(boxes.len(), frame.n().len())?;
                frame.fill(&boxes[..]);
                Ok(())
            })?
        })
    }

    /// Asks for the pairs.
    fn submit(&self, py: Python<'_>) -> PyResult<PyPendingFrame> {
        self.viewed.submit(py, NarrowFrame::submit)
    }

    /// Asks for the pairs of two sets.
    fn submit_between(&self, py: Python<'_>, first: u32) -> PyResult<PyPendingFrame> {
        self.viewed.submit(py, move |frame| frame.submit_between(BoxCount::new(first)))
    }

    /// Asks for the pairs that rules let meet.
    fn submit_with(&self, py: Python<'_>, rules: &PyRules) -> PyResult<PyPendingFrame> {
        let rules = rules.shared();
        self.viewed.submit(py, move |frame| frame.submit_with(&rules))
    }

    /// As `submit_with`, for rules that stay.
    fn submit_with_kept(&self, py: Python<'_>, rules: &PyRules) -> PyResult<PyPendingFrame> {
        let rules = rules.shared();
        self.viewed.submit(py, move |frame| frame.submit_with_kept(&rules))
    }
}

/// The longest wait: beyond it, instants of a clock may overflow.
const LONGEST_WAIT: f64 = 86_400.0;

/// A time in seconds, a day at most.
pub fn seconds(given: f64) -> PyResult<Duration> {
    let refused = || PyValueError::new_err(format!("a time of {given} s: give 0 or more seconds"));
    if given.is_nan() || given < 0.0 {
        return Err(refused());
    }
    Duration::try_from_secs_f64(given.min(LONGEST_WAIT)).map_err(|_| refused())
}

/// A frame under way. Dropped, its answer is discarded.
#[pyclass(frozen, name = "PendingFrame", module = "pairmask")]
pub struct PyPendingFrame {
    pending: Guarded<PendingFrame>,
}

impl PyPendingFrame {
    pub fn new(pending: PendingFrame) -> Self {
        let gone = "the pairs of this frame were taken, or another thread waits for them";
        Self { pending: Guarded::new(pending, gone) }
    }
}

#[pymethods]
impl PyPendingFrame {
    /// Waits for the pairs, while other Python threads run.
    #[pyo3(signature = (timeout=None))]
    fn wait(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<PyPairMask> {
        let timeout = timeout.map(seconds).transpose()?;
        let mut pending = self.pending.take(py)?;
        let Some(timeout) = timeout else {
            let waited = py.detach(|| pending.wait());
            return waited.map(PyPairMask::new).map_err(Raise::raise);
        };
        let (waited, pending) = py.detach(move || (pending.wait_timeout(timeout), pending));
        if waited.is_err() {
            // Still under way, if it was the time that ran out.
            self.pending.put(py, pending)?;
        }
        waited.map(PyPairMask::new).map_err(Raise::raise)
    }

    /// The pairs if the answer has come, else `None`.
    fn try_take(&self, py: Python<'_>) -> PyResult<Option<PyPairMask>> {
        let taken = self.pending.with_detached(py, PendingFrame::try_take)?;
        taken.map(|mask| mask.map(PyPairMask::new)).map_err(Raise::raise)
    }
}
