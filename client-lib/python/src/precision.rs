//! Precisions of narrow frames.

use pairmask::{Aabb, Bounds, Precision};
use pyo3::prelude::*;

use crate::errors::Raise;
use crate::sources::Boxes;

/// The precision of the boxes of a frame. None misses a pair.
#[pyclass(frozen, eq, name = "Precision", module = "pairmask")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyPrecision {
    pub precision: Precision,
}

#[pymethods]
impl PyPrecision {
    /// float32, no extra pair.
    #[staticmethod]
    fn exact() -> Self {
        Self { precision: Precision::Exact }
    }

    /// Halves: precise near the origin, none beyond ±65,504.
    #[staticmethod]
    fn f16() -> Self {
        Self { precision: Precision::F16 }
    }

    /// 65,536 cells on each axis between two corners.
    #[staticmethod]
    fn q16(low: [f32; 3], high: [f32; 3]) -> PyResult<Self> {
        Ok(Self { precision: Precision::Q16(Bounds::new(low, high).map_err(Raise::raise)?) })
    }

    /// 256 cells on each axis between two corners.
    #[staticmethod]
    fn q8(low: [f32; 3], high: [f32; 3]) -> PyResult<Self> {
        Ok(Self { precision: Precision::Q8(Bounds::new(low, high).map_err(Raise::raise)?) })
    }

    /// `q16` between the outermost finite coordinates of boxes.
    #[staticmethod]
    fn q16_around(py: Python<'_>, boxes: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self { precision: Precision::Q16(Bounds::around(&all(py, boxes)?)) })
    }

    /// `q8` between the outermost finite coordinates of boxes.
    #[staticmethod]
    fn q8_around(py: Python<'_>, boxes: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self { precision: Precision::Q8(Bounds::around(&all(py, boxes)?)) })
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.precision)
    }
}

fn all(py: Python<'_>, boxes: &Bound<'_, PyAny>) -> PyResult<Vec<Aabb>> {
    Boxes::of(boxes)?.to_vec(py)
}
