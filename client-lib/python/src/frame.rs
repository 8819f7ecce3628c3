//! Frames being filled: memory that numpy arrays lie over until the frame is submitted.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pairmask::{Error, Frame, FrameOptions, PendingFrame, Quantized, Sphere};
use pyo3::exceptions::{PyAttributeError, PyBufferError, PyValueError};
use pyo3::prelude::*;

use crate::arrays::{Rows, check_len};
use crate::errors::{Raise, misused};
use crate::guarded::Guarded;
use crate::memory::{Memory, Number};
use crate::pairs::PyPairMask;
use crate::process;
use crate::rules::PyRules;
use crate::sources::Boxes;

/// A frame until it is submitted, and how many arrays lie over it.
struct Filling {
    /// `None` once it is submitted.
    frame: Option<AnyFrame>,
    views: usize,
}

/// A frame that arrays may lie over. While any does, the frame is neither written nor submitted: an array
/// would then read or write memory that another process works on.
struct Viewed {
    filling: Arc<Mutex<Filling>>,
}

/// Keeps a frame's memory where it is, for an array.
struct View {
    filling: Arc<Mutex<Filling>>,
}

impl Drop for View {
    fn drop(&mut self) {
        self.filling.lock().unwrap_or_else(PoisonError::into_inner).views -= 1;
    }
}

impl Viewed {
    fn new(frame: AnyFrame) -> Self {
        Self { filling: Arc::new(Mutex::new(Filling { frame: Some(frame), views: 0 })) }
    }

    /// A new array over the frame's memory. The lock is never held for long: nothing waits under it.
    fn view<'py, T: Number, const N: usize>(
        &self,
        py: Python<'py>,
        rows: impl FnOnce(&mut AnyFrame) -> PyResult<&mut [[T; N]]>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        let memory = {
            let Filling { frame, views } = &mut *filling;
            let rows = rows(frame.as_mut().ok_or_else(gone)?)?;
            *views += 1;
            let view = View { filling: Arc::clone(&self.filling) };
            Memory::of_writable(rows, Box::new(view))
        };
        drop(filling);
        memory.into_array(py)
    }

    /// Calls `f` with the frame where no array lies over it.
    fn with<R>(&self, f: impl FnOnce(&mut AnyFrame) -> R) -> PyResult<R> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        filling.check()?;
        filling.frame.as_mut().map(f).ok_or_else(gone)
    }

    /// The frame, where no array lies over it.
    fn take(&self) -> PyResult<AnyFrame> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        filling.check()?;
        filling.frame.take().ok_or_else(gone)
    }
}

impl Drop for Filling {
    fn drop(&mut self) {
        process::drop_here(self.frame.take());
    }
}

impl Filling {
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

/// A frame of any objects.
enum AnyFrame {
    Boxes(Frame),
    Spheres(Frame<Sphere>),
    Quantized(Frame<Quantized>),
}

impl AnyFrame {
    fn submit(self, options: &FrameOptions) -> Result<PendingFrame, Error> {
        match self {
            Self::Boxes(frame) => frame.submit_with(options),
            Self::Spheres(frame) => frame.submit_with(options),
            Self::Quantized(frame) => frame.submit_with(options),
        }
    }
}

/// Memory for the boxes or spheres of one frame.
#[pyclass(frozen, name = "Frame", module = "pairmask")]
pub struct PyFrame {
    n: usize,
    is_shared: bool,
    kind: Kind,
    viewed: Viewed,
}

/// What a frame holds.
#[derive(Clone, Copy)]
enum Kind {
    Boxes,
    Spheres,
    Quantized,
}

impl PyFrame {
    pub fn of_boxes(frame: Frame) -> Self {
        let (n, is_shared) = (frame.n().len(), frame.is_shared());
        Self { n, is_shared, kind: Kind::Boxes, viewed: Viewed::new(AnyFrame::Boxes(frame)) }
    }

    pub fn of_spheres(frame: Frame<Sphere>) -> Self {
        let (n, is_shared) = (frame.n().len(), frame.is_shared());
        Self { n, is_shared, kind: Kind::Spheres, viewed: Viewed::new(AnyFrame::Spheres(frame)) }
    }

    pub fn of_quantized(frame: Frame<Quantized>) -> Self {
        let (n, is_shared) = (frame.n().len(), frame.is_shared());
        Self {
            n,
            is_shared,
            kind: Kind::Quantized,
            viewed: Viewed::new(AnyFrame::Quantized(frame)),
        }
    }
}

fn other_frame(wanted: &str) -> PyErr {
    PyAttributeError::new_err(format!("this frame has no array of {wanted}: write() fills it"))
}

#[pymethods]
impl PyFrame {
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

    /// The boxes as a new array over the frame's memory, contents unspecified until written. Boxes that are
    /// quantized have none.
    #[getter]
    fn boxes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.viewed.view(py, |frame| match frame {
            AnyFrame::Boxes(frame) => Ok(frame.raw_mut()),
            _ => Err(other_frame("boxes")),
        })
    }

    /// The spheres as a new array over the frame's memory, `x y z radius` a row.
    #[getter]
    fn spheres<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.viewed.view(py, |frame| match frame {
            AnyFrame::Spheres(frame) => Ok(frame.raw_mut()),
            _ => Err(other_frame("spheres")),
        })
    }

    /// Writes every box or sphere.
    fn write(&self, py: Python<'_>, objects: &Bound<'_, PyAny>) -> PyResult<()> {
        // What is written is ready before the frame is locked: nothing waits under the lock.
        match self.kind {
            Kind::Boxes => {
                let boxes = Boxes::of(objects)?;
                self.viewed.with(|frame| match frame {
                    AnyFrame::Boxes(frame) => boxes.write(py, frame.boxes_mut()),
                    _ => Err(other_frame("boxes")),
                })?
            }
            Kind::Spheres => {
                let rows = Rows::of(objects, 4)?;
                self.viewed.with(|frame| match frame {
                    AnyFrame::Spheres(frame) => rows.write_spheres(py, frame.spheres_mut()),
                    _ => Err(other_frame("spheres")),
                })?
            }
            Kind::Quantized => {
                let boxes = Boxes::of(objects)?.to_vec(py)?;
                check_len(boxes.len(), self.n)?;
                let write = |frame: &mut AnyFrame| match frame {
                    AnyFrame::Quantized(frame) => frame.write(&boxes[..]).map_err(Raise::raise),
                    _ => Err(other_frame("boxes")),
                };
                py.detach(|| self.viewed.with(write))?
            }
        }
    }

    /// Asks for the pairs, those that collision filters let meet, or of two sets: the first `split_at` boxes against all
    /// others. A daemon is sent the same `filters` once.
    #[pyo3(signature = (*, filters=None, split_at=None))]
    fn submit(
        &self,
        py: Python<'_>,
        filters: Option<&PyRules>,
        split_at: Option<usize>,
    ) -> PyResult<PyPendingFrame> {
        let options = FrameOptions { filters: filters.map(PyRules::shared), split_at };
        process::check()?;
        let frame = self.viewed.take()?;
        py.detach(|| frame.submit(&options)).map(PyPendingFrame::new).map_err(Raise::raise)
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
