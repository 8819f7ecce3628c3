//! Arrays that come in, as arguments of functions of Python.
//!
//! Arrays of float32 that lie row by row are read where they lie. All others go through `pairmask._convert`,
//! which decides what is accepted, what is rounded and what is refused.

use bytemuck::Pod;
use pairmask::Aabb;
use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A row of float32 for each box or sphere. As an argument: rows of boxes.
pub struct Rows(PyBuffer<f32>);

impl<'py> FromPyObject<'_, 'py> for Rows {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Self::of(&given, 6)
    }
}

impl Rows {
    /// Rows of so many columns.
    pub fn of(given: &Bound<'_, PyAny>, columns: usize) -> PyResult<Self> {
        let py = given.py();
        // Not of subclasses: a masked array has a buffer that knows nothing of its mask.
        if given.get_type().is(imported!(py, "numpy", "ndarray")?)
            && let Ok(buffer) = PyBuffer::<f32>::get(given)
            && matches!(buffer.shape(), [_, len] if *len == columns)
            && buffer.is_c_contiguous()
            // pyo3 reads numbers of the other byte order as this machine's.
            && !matches!(buffer.format().to_bytes(), [b'>' | b'<' | b'!' | b'=', ..])
        {
            return Ok(Self(buffer));
        }
        let array = imported!(py, "pairmask._convert", "rows")?.call1((given, columns))?;
        PyBuffer::get(&array).map(Self)
    }

    /// How many rows.
    pub fn len(&self) -> usize {
        self.0.shape()[0]
    }

    /// Writes as many objects as there are rows: boxes or spheres, by the columns that were asked for.
    pub fn write<T: Pod>(&self, py: Python<'_>, out: &mut [T]) -> PyResult<()> {
        check_len(self.len(), out.len())?;
        self.0.copy_to_slice(py, bytemuck::cast_slice_mut(out))
    }

    /// The boxes.
    pub fn boxes(&self, py: Python<'_>) -> PyResult<Vec<Aabb>> {
        let mut boxes = vec![Aabb::default(); self.len()];
        self.write(py, &mut boxes)?;
        Ok(boxes)
    }
}

/// Fails where there are not as many rows as boxes.
pub fn check_len(rows: usize, n: usize) -> PyResult<()> {
    if rows == n {
        return Ok(());
    }
    let text = format!("{rows} rows for {n} boxes or spheres: give one for each");
    Err(PyValueError::new_err(text))
}

/// Rows of numbers that are no boxes. float64 is refused where float32 does not hold it.
pub struct Numbers<const N: usize>(pub Vec<[f32; N]>);

impl<'py, const N: usize> FromPyObject<'_, 'py> for Numbers<N> {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array = imported!(given.py(), "pairmask._convert", "exact")?.call1((given, N))?;
        Ok(Self(numbers::<f32>(&array)?.as_chunks().0.to_vec()))
    }
}

/// Pairs of indices.
pub struct Pairs(pub Vec<[u32; 2]>);

impl<'py> FromPyObject<'_, 'py> for Pairs {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array = imported!(given.py(), "pairmask._convert", "pairs")?.call1((given,))?;
        Ok(Self(numbers(&array)?.as_chunks().0.to_vec()))
    }
}

/// The numbers of an array that was converted.
pub fn numbers<T: Element>(array: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    PyBuffer::get(array)?.to_vec(array.py())
}
