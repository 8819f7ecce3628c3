//! Frames being filled: memory that numpy arrays lie over until the frame is submitted.

use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use bytemuck::cast_slice_mut;
use pairmask::{Frame, FrameOptions, PairMask, Pending, Quantized, Sphere};
use pyo3::exceptions::{PyAttributeError, PyBufferError};
use pyo3::prelude::*;

use crate::arrays::{Rows, check_len};
use crate::errors::{invalid, raised};
use crate::guarded::Guarded;
use crate::memory::Array;
use crate::pairs::PyPairMask;
use crate::rules::PyRules;

/// A frame of any objects.
pub enum AnyFrame {
    Boxes(Frame),
    Spheres(Frame<Sphere>),
    Quantized(Frame<Quantized>),
}

/// Memory for the boxes or spheres of one frame.
///
/// Arrays may lie over it. While any does, the frame is neither written as a whole nor submitted: the array would
/// then read or write memory that another process works on.
#[pyclass(frozen, name = "Frame", module = "pairmask")]
pub struct PyFrame {
    /// Boxes or spheres in this frame.
    #[pyo3(get)]
    n: usize,
    /// Whether they lie in shared memory.
    #[pyo3(get)]
    is_shared: bool,
    /// Numbers of a row.
    columns: usize,
    /// Each array over the frame's memory has an `Arc` of its own, and makes it under the lock.
    frame: Arc<Guarded<AnyFrame>>,
}

impl PyFrame {
    pub fn new(frame: AnyFrame) -> Self {
        let (n, is_shared, columns) = match &frame {
            AnyFrame::Boxes(frame) => (frame.n(), frame.is_shared(), 6),
            AnyFrame::Spheres(frame) => (frame.n(), frame.is_shared(), 4),
            AnyFrame::Quantized(frame) => (frame.n(), frame.is_shared(), 6),
        };
        let frame = Arc::new(Guarded::new(frame, "the frame was submitted"));
        Self { n: n.len(), is_shared, columns, frame }
    }

    /// A new array of so many columns over the frame's memory.
    fn view(&self, py: Python<'_>, columns: usize) -> PyResult<Array> {
        let owner = || Box::new(Arc::clone(&self.frame));
        let array = self.frame.with(py, |frame| match (frame, columns) {
            (AnyFrame::Boxes(frame), 6) => {
                Some(Array::over(cast_slice_mut::<_, [f32; 6]>(frame.boxes_mut()), owner()))
            }
            (AnyFrame::Spheres(frame), 4) => {
                Some(Array::over(cast_slice_mut::<_, [f32; 4]>(frame.spheres_mut()), owner()))
            }
            _ => None,
        })?;
        let text = "this frame has no such array: write() fills it";
        array.ok_or_else(|| PyAttributeError::new_err(text))
    }

    /// The lock of the frame, where no array lies over it.
    fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Option<AnyFrame>>> {
        let held = self.frame.lock(py)?;
        match Arc::strong_count(&self.frame) - 1 {
            0 => Ok(held),
            views => Err(PyBufferError::new_err(format!(
                "{views} arrays lie over this frame's memory: drop them (del) before it is written as a whole or \
                 submitted"
            ))),
        }
    }
}

#[pymethods]
impl PyFrame {
    fn __repr__(&self) -> String {
        format!("<Frame ({}, {})>", self.n, self.columns)
    }

    /// The boxes (n, 6) as a new array over the frame's memory, contents unspecified until written. Boxes that
    /// are quantized have none.
    #[getter]
    fn boxes(&self, py: Python<'_>) -> PyResult<Array> {
        self.view(py, 6)
    }

    /// The spheres (n, 4) as a new array over the frame's memory, `x y z radius` a row.
    #[getter]
    fn spheres(&self, py: Python<'_>) -> PyResult<Array> {
        self.view(py, 4)
    }

    /// Writes every box (n, 6) or sphere (n, 4).
    fn write(&self, py: Python<'_>, objects: &Bound<'_, PyAny>) -> PyResult<()> {
        // Converted before the frame is locked, by code of Python.
        let rows = Rows::of(objects, self.columns)?;
        check_len(rows.len(), self.n)?;
        match self.lock(py)?.as_mut().ok_or_else(|| self.frame.closed())? {
            AnyFrame::Boxes(frame) => rows.write(py, frame.boxes_mut()),
            AnyFrame::Spheres(frame) => rows.write(py, frame.spheres_mut()),
            AnyFrame::Quantized(frame) => {
                let boxes = rows.boxes(py)?;
                py.detach(|| frame.write(&boxes[..])).map_err(raised)
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
        let options = FrameOptions { filters: filters.map(|rules| Arc::clone(&rules.0)), split_at };
        let frame = self.lock(py)?.take().ok_or_else(|| self.frame.closed())?;
        let submitted = py.detach(|| match frame {
            AnyFrame::Boxes(frame) => frame.submit_with(&options),
            AnyFrame::Spheres(frame) => frame.submit_with(&options),
            AnyFrame::Quantized(frame) => frame.submit_with(&options),
        });
        let text = "the pairs of this frame were received, or another thread waits for them";
        Ok(PyPendingFrame { pending: Guarded::new(submitted.map_err(raised)?, text) })
    }
}

/// The longest wait: beyond it, instants of a clock may overflow.
const LONGEST_WAIT: f64 = 86_400.0;

/// A time in seconds, a day at most.
pub fn seconds(given: f64) -> PyResult<Duration> {
    // A NaN stays one.
    let bounded = if given > LONGEST_WAIT { LONGEST_WAIT } else { given };
    let refused = |_| invalid(format!("a time of {given} s: give 0 or more seconds"));
    Duration::try_from_secs_f64(bounded).map_err(refused)
}

/// A frame under way. Dropped, its answer is discarded.
#[pyclass(frozen, name = "PendingFrame", module = "pairmask")]
pub struct PyPendingFrame {
    pending: Guarded<Pending<PairMask>>,
}

#[pymethods]
impl PyPendingFrame {
    /// Waits for the pairs, while other Python threads run.
    #[pyo3(signature = (timeout=None))]
    fn wait(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<PyPairMask> {
        let timeout = timeout.map(seconds).transpose()?;
        let mut pending = self.pending.take(py)?;
        let (waited, rest) = py.detach(move || match timeout {
            Some(timeout) => (pending.wait_timeout(timeout), Some(pending)),
            None => (pending.wait(), None),
        });
        if waited.is_err() {
            // Still under way, if it was the time that ran out.
            *self.pending.lock(py)? = rest;
        }
        waited.map(PyPairMask::new).map_err(raised)
    }

    /// The pairs if the answer has come, else `None`.
    fn try_receive(&self, py: Python<'_>) -> PyResult<Option<PyPairMask>> {
        let received = self.pending.with_detached(py, Pending::try_receive)?;
        received.map(|mask| mask.map(PyPairMask::new)).map_err(raised)
    }
}
