//! Precisions of narrow frames.

use pairmask::{Bounds, Precision};
use pyo3::prelude::*;

use crate::arrays::Rows;

/// The precision of the boxes of a frame. None misses a pair.
#[pyclass(frozen, eq, name = "Precision", module = "pairmask")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyPrecision(pub Precision);

#[pymethods]
impl PyPrecision {
    /// float32, no extra pair.
    #[staticmethod]
    fn exact() -> Self {
        Self(Precision::Exact)
    }

    /// Halves: precise near the origin, none beyond ±65,504.
    #[staticmethod]
    fn f16() -> Self {
        Self(Precision::F16)
    }

    /// 65,536 cells on each axis, between the outermost finite coordinates of boxes (n, 6): of all that there are,
    /// or of one around them.
    #[staticmethod]
    fn q16(py: Python<'_>, boxes: Rows) -> PyResult<Self> {
        Ok(Self(Precision::Q16(Bounds::around(&boxes.boxes(py)?))))
    }

    /// 256 cells on each axis, between the same.
    #[staticmethod]
    fn q8(py: Python<'_>, boxes: Rows) -> PyResult<Self> {
        Ok(Self(Precision::Q8(Bounds::around(&boxes.boxes(py)?))))
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.0)
    }
}
