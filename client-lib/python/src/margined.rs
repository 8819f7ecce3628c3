//! Sessions that ask only when something has moved by more than a margin.

use pairmask::error::MarginedError;
use pairmask::{Margin, Margined, MarginedPairs, Precision};
use pyo3::prelude::*;

use crate::errors::Raise;
use crate::guarded::Guarded;
use crate::memory::Memory;
use crate::pairs::pairs_of;
use crate::precision::PyPrecision;
use crate::scene::margined_pairs;
use crate::session::PySession;
use crate::sources::Boxes;

/// A session that asks only when a box has moved by more than a margin. It keeps the last answer, which holds one
/// of the session's three places for frames.
#[pyclass(frozen, name = "Margined", module = "pairmask")]
pub struct PyMargined {
    margined: Guarded<Margined>,
    margin: f32,
}

#[pymethods]
impl PyMargined {
    /// A session with a margin. The session is this object's from now on.
    #[new]
    #[pyo3(signature = (session, margin, *, precision=None))]
    fn new(
        py: Python<'_>,
        session: &PySession,
        margin: f32,
        precision: Option<&PyPrecision>,
    ) -> PyResult<Self> {
        let margin = Margin::new(margin).map_err(Raise::raise)?;
        let precision = precision.map_or(Precision::Exact, |precision| precision.precision);
        let margined = Margined::new(session.take(py)?, margin).with_precision(precision);
        Ok(Self {
            margined: Guarded::new(margined, "the session was closed"),
            margin: margin.get(),
        })
    }

    /// The pairs among boxes: "exact" ones overlap now, among "near" ones are pairs that are near.
    #[pyo3(signature = (boxes, pairs="exact"))]
    fn cull<'py>(
        &self,
        py: Python<'py>,
        boxes: &Bound<'py, PyAny>,
        pairs: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let pairs = margined_pairs(pairs)?;
        let boxes = Boxes::of(boxes)?.to_vec(py)?;
        let found = self.margined.with_detached(py, |margined| {
            let kept = margined.cull(&boxes)?;
            Ok::<_, MarginedError>(match pairs {
                MarginedPairs::Exact => kept.exact_pairs().map(|(a, b)| [a, b]).collect(),
                MarginedPairs::Near => pairs_of(kept.mask()),
            })
        })?;
        Memory::of_rows(found.map_err(Raise::raise)?).into_array(py)
    }

    /// Discards the kept answer, so that the next frame makes a request.
    fn forget(&self, py: Python<'_>) -> PyResult<()> {
        self.margined.with(py, Margined::forget)
    }

    /// Requests made and saved so far.
    #[getter]
    fn stats(&self, py: Python<'_>) -> PyResult<PyMarginStats> {
        let stats = self.margined.with(py, |margined| margined.stats())?;
        Ok(PyMarginStats { requests: stats.requests, skipped: stats.skipped })
    }

    /// The margin.
    #[getter]
    fn margin(&self) -> f32 {
        self.margin
    }

    /// What would serve the next request: `daemon` or `in-process`.
    fn served_by(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.margined.with(py, |margined| margined.session_mut().served_by().as_str())
    }

    /// Ends it, and its session.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.margined.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }
}

/// Frames that were requested, and frames that an earlier answer served.
#[pyclass(frozen, get_all, name = "MarginStats", module = "pairmask")]
pub struct PyMarginStats {
    /// Frames for which a request was made.
    requests: u64,
    /// Frames that the last answer served.
    skipped: u64,
}
