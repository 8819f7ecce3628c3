//! Arrays that come in, as arguments of functions of Python.
//!
//! Arrays of float32 that lie row by row are read where they lie. All others go through `pairmask._convert`,
//! which says what is taken and what is refused.

use bytemuck::Pod;
use pairmask::{Aabb, Sphere};
use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// An object that a row of numbers stands for, float32 as they are.
pub trait Object<const N: usize>: Pod {
    /// The same of float64, rounded outward.
    fn outward(row: [f64; N]) -> Self;
}

impl Object<6> for Aabb {
    fn outward([a, b, c, d, e, f]: [f64; 6]) -> Self {
        Self::outward_from_f64([a, b, c], [d, e, f], [0.0; 3])
    }
}

impl Object<4> for Sphere {
    fn outward([x, y, z, radius]: [f64; 4]) -> Self {
        Self::outward_from_f64([x, y, z], radius)
    }
}

/// A row for each box or sphere. As an argument: rows of boxes.
pub enum Rows {
    F32(PyBuffer<f32>),
    F64(PyBuffer<f64>),
}

impl<'py> FromPyObject<'_, 'py> for Rows {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        Self::of(&given, 6)
    }
}

/// The numbers of an array, if they are of this type and lie row by row.
fn rows_of<T: Element>(array: &Bound<'_, PyAny>, columns: usize) -> Option<PyBuffer<T>> {
    let buffer = PyBuffer::<T>::get(array).ok()?;
    // pyo3 takes numbers of the other byte order for this machine's.
    let is_native = !matches!(buffer.format().to_bytes(), [b'>' | b'<' | b'!' | b'=', ..]);
    let is_right = matches!(buffer.shape(), [_, len] if *len == columns);
    (is_native && is_right && buffer.is_c_contiguous()).then_some(buffer)
}

impl Rows {
    /// Rows of so many columns.
    pub fn of(given: &Bound<'_, PyAny>, columns: usize) -> PyResult<Self> {
        let py = given.py();
        // Not of subclasses: a masked array has a buffer that knows nothing of its mask.
        let is_plain = given.get_type().is(imported!(py, "numpy", "ndarray")?);
        if is_plain && let Some(rows) = rows_of(given, columns) {
            return Ok(Self::F32(rows));
        }
        let array = imported!(py, "pairmask._convert", "floats")?.call1((given, columns))?;
        match rows_of(&array, columns) {
            Some(rows) => Ok(Self::F32(rows)),
            None => PyBuffer::get(&array).map(Self::F64),
        }
    }

    /// How many rows.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(rows) => rows.shape()[0],
            Self::F64(rows) => rows.shape()[0],
        }
    }

    /// Writes as many objects as there are rows.
    pub fn write<T: Object<N>, const N: usize>(
        &self,
        py: Python<'_>,
        out: &mut [T],
    ) -> PyResult<()> {
        check_len(self.len(), out.len())?;
        match self {
            Self::F32(rows) => rows.copy_to_slice(py, bytemuck::cast_slice_mut(out)),
            Self::F64(rows) => {
                let wide = rows.to_vec(py)?;
                out.iter_mut().zip(wide.as_chunks().0).for_each(|(to, row)| *to = T::outward(*row));
                Ok(())
            }
        }
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
