//! Arrays that come in: numpy arrays and whatever becomes one.
//!
//! Arrays of the right type that lie row by row are read where they lie. All others go through
//! `pairmask._convert`, which says what is taken and what is refused.

use pairmask::{Aabb, Sphere};
use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Rows of numbers.
pub enum Rows {
    F32(PyBuffer<f32>),
    F64(PyBuffer<f64>),
}

/// The buffer of an object with numbers of this type, if it has one. pyo3 takes numbers of the other byte order
/// for this machine's: those are left to `pairmask._convert`.
fn buffer_of<T: Element>(given: &Bound<'_, PyAny>) -> Option<PyBuffer<T>> {
    static PLAIN: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let plain = PLAIN.import(given.py(), "numpy", "ndarray").ok()?;
    // A masked array has a buffer that knows nothing of its mask: `pairmask._convert` refuses it.
    if !given.get_type().is(plain) && given.hasattr("mask").unwrap_or(true) {
        return None;
    }
    let buffer = PyBuffer::<T>::get(given).ok()?;
    (!matches!(buffer.format().to_bytes(), [b'>' | b'<' | b'!' | b'=', ..])).then_some(buffer)
}

/// The buffer of an array whose rows lie one after another, if it is one.
fn rows_of<T: Element>(given: &Bound<'_, PyAny>, columns: usize) -> Option<PyBuffer<T>> {
    let buffer = buffer_of::<T>(given)?;
    let is_right = matches!(buffer.shape(), [_, len] if *len == columns);
    (is_right && buffer.is_c_contiguous()).then_some(buffer)
}

/// What `pairmask._convert.floats` makes of an object: an array of f32 or of f64.
fn converted<'py>(
    given: &Bound<'py, PyAny>,
    columns: usize,
    may_be_one: bool,
) -> PyResult<Bound<'py, PyAny>> {
    static FLOATS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let floats = FLOATS.import(given.py(), "pairmask._convert", "floats")?;
    floats.call1((given, columns, may_be_one))
}

impl Rows {
    /// Rows of so many columns.
    pub fn of(given: &Bound<'_, PyAny>, columns: usize) -> PyResult<Self> {
        Self::read(given, columns, false)
    }

    /// The same, where a single row may come without the brackets around it.
    pub fn of_some(given: &Bound<'_, PyAny>, columns: usize) -> PyResult<Self> {
        Self::read(given, columns, true)
    }

    fn read(given: &Bound<'_, PyAny>, columns: usize, may_be_one: bool) -> PyResult<Self> {
        if let Some(rows) = rows_of::<f32>(given, columns) {
            return Ok(Self::F32(rows));
        }
        let array = converted(given, columns, may_be_one)?;
        if let Some(rows) = rows_of::<f32>(&array, columns) {
            return Ok(Self::F32(rows));
        }
        let rows = rows_of::<f64>(&array, columns);
        rows.map(Self::F64).ok_or_else(|| PyValueError::new_err("not an array of numbers"))
    }

    /// How many rows.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(rows) => rows.shape()[0],
            Self::F64(rows) => rows.shape()[0],
        }
    }

    /// Fails where there are not so many rows.
    pub fn check_len(&self, n: usize) -> PyResult<()> {
        check_len(self.len(), n)
    }

    /// Writes boxes, those of f64 rounded outward. As many as there are rows.
    pub fn write_boxes(&self, py: Python<'_>, out: &mut [Aabb]) -> PyResult<()> {
        self.check_len(out.len())?;
        match self {
            Self::F32(rows) => rows.copy_to_slice(py, bytemuck::cast_slice_mut(out)),
            Self::F64(rows) => write_outward(py, rows, [0.0; 3], out),
        }
    }

    /// The boxes.
    pub fn boxes(&self, py: Python<'_>) -> PyResult<Vec<Aabb>> {
        let mut boxes = vec![Aabb::default(); self.len()];
        self.write_boxes(py, &mut boxes)?;
        Ok(boxes)
    }

    /// Writes spheres, those of f64 rounded outward.
    pub fn write_spheres(&self, py: Python<'_>, out: &mut [Sphere]) -> PyResult<()> {
        self.check_len(out.len())?;
        match self {
            Self::F32(rows) => rows.copy_to_slice(py, bytemuck::cast_slice_mut(out)),
            Self::F64(rows) => {
                let mut wide = vec![[0.0; 4]; out.len()];
                rows.copy_to_slice(py, wide.as_flattened_mut())?;
                for (to, [x, y, z, radius]) in out.iter_mut().zip(wide) {
                    *to = Sphere::outward_from_f64([x, y, z], radius);
                }
                Ok(())
            }
        }
    }

    /// Numbers that are no boxes. f64 is refused where f32 does not hold it. The rows were asked for with as many
    /// columns.
    pub fn numbers<const N: usize>(&self, py: Python<'_>) -> PyResult<Vec<[f32; N]>> {
        let mut numbers = vec![[0.0; N]; self.len()];
        match self {
            Self::F32(rows) => rows.copy_to_slice(py, numbers.as_flattened_mut())?,
            Self::F64(rows) => {
                let mut wide = vec![0.0; N * self.len()];
                rows.copy_to_slice(py, &mut wide)?;
                for (to, from) in numbers.as_flattened_mut().iter_mut().zip(wide) {
                    *to = from as f32;
                    if f64::from(*to) != from && !from.is_nan() {
                        let text = format!("{from} is no number of float32: round it yourself");
                        return Err(PyValueError::new_err(text));
                    }
                }
            }
        }
        Ok(numbers)
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

/// Writes boxes of f64 relative to an origin, rounded outward.
fn write_outward(
    py: Python<'_>,
    rows: &PyBuffer<f64>,
    origin: [f64; 3],
    out: &mut [Aabb],
) -> PyResult<()> {
    let mut cells = vec![0.0; rows.item_count()];
    rows.copy_to_slice(py, &mut cells)?;
    for (to, [a, b, c, d, e, f]) in out.iter_mut().zip(cells.as_chunks::<6>().0.iter().copied()) {
        *to = Aabb::outward_from_f64([a, b, c], [d, e, f], origin);
    }
    Ok(())
}

/// A new array of boxes, which Python may write.
pub fn new_boxes<'py>(py: Python<'py>, boxes: &[Aabb]) -> PyResult<Bound<'py, PyAny>> {
    static EMPTY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let empty = EMPTY.import(py, "numpy", "empty")?;
    let array = empty.call1(((boxes.len(), 6), "float32"))?;
    PyBuffer::<f32>::get(&array)?.copy_from_slice(py, bytemuck::cast_slice(boxes))?;
    Ok(array)
}

/// Boxes of f64, relative to an origin and rounded outward: float32 boxes that contain them.
#[pyfunction]
#[pyo3(signature = (boxes, origin=[0.0; 3]))]
pub fn outward_from_f64<'py>(
    py: Python<'py>,
    boxes: &Bound<'py, PyAny>,
    origin: [f64; 3],
) -> PyResult<Bound<'py, PyAny>> {
    static DOUBLES: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let doubles = DOUBLES.import(py, "pairmask._convert", "doubles")?.call1((boxes, 6))?;
    let rows = PyBuffer::<f64>::get(&doubles)?;
    let mut out = vec![Aabb::default(); rows.shape()[0]];
    write_outward(py, &rows, origin, &mut out)?;
    new_boxes(py, &out)
}

/// Boxes that hold one point each, for queries.
#[pyfunction]
pub fn points<'py>(py: Python<'py>, at: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let points = Rows::of(at, 3)?.numbers(py)?;
    let boxes: Vec<Aabb> = points.into_iter().map(Aabb::point).collect();
    new_boxes(py, &boxes)
}

/// What boxes may touch on their way from one place to another.
#[pyfunction]
pub fn swept<'py>(
    py: Python<'py>,
    before: &Bound<'py, PyAny>,
    after: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let before = Rows::of(before, 6)?.boxes(py)?;
    let after = Rows::of(after, 6)?;
    after.check_len(before.len())?;
    let after = after.boxes(py)?;
    let both = before.iter().zip(&after);
    let boxes: Vec<Aabb> = both.map(|(from, to)| Aabb::swept(from, to)).collect();
    new_boxes(py, &boxes)
}

/// What boxes may touch while they move by a displacement.
#[pyfunction]
pub fn swept_by<'py>(
    py: Python<'py>,
    boxes: &Bound<'py, PyAny>,
    displacements: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let boxes = Rows::of(boxes, 6)?.boxes(py)?;
    let displacements = Rows::of(displacements, 3)?;
    displacements.check_len(boxes.len())?;
    let both = boxes.iter().zip(displacements.numbers(py)?);
    let boxes: Vec<Aabb> = both.map(|(b, by)| b.swept_by(by)).collect();
    new_boxes(py, &boxes)
}

/// Integers of one type, in one row.
pub fn integers<T: Element + Default>(
    given: &Bound<'_, PyAny>,
    numpy_type: &'static str,
) -> PyResult<Vec<T>> {
    static INTEGERS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = given.py();
    if let Some(buffer) = buffer_of::<T>(given)
        && buffer.dimensions() == 1
    {
        return buffer.to_vec(py);
    }
    let array = INTEGERS.import(py, "pairmask._convert", "integers")?.call1((given, numpy_type))?;
    PyBuffer::<T>::get(&array)?.to_vec(py)
}

/// Pairs of indices.
pub fn pairs(given: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 2]>> {
    static PAIRS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = given.py();
    let array = PAIRS.import(py, "pairmask._convert", "pairs")?.call1((given,))?;
    let numbers = PyBuffer::<u32>::get(&array)?.to_vec(py)?;
    Ok(numbers.as_chunks().0.to_vec())
}
