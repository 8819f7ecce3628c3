//! Memory that Python reads or writes where it lies, through the buffer protocol.
//!
//! All `unsafe` code of the extension is here. It relies on three facts: the owner in a [`Memory`]
//! holds what lies at its address, an address and its length never change while the object lives, and every
//! buffer that Python holds keeps the object alive.
#![allow(unsafe_code)]

use std::ffi::{c_int, c_void};

use pyo3::exceptions::PyBufferError;
use pyo3::ffi;
use pyo3::prelude::*;

/// A number that numpy knows.
pub trait Number: Copy + Send + Sync + 'static {
    /// Its type, in the letters of numpy.
    const DTYPE: &'static str;
}

impl Number for f32 {
    const DTYPE: &'static str = "f4";
}
impl Number for u32 {
    const DTYPE: &'static str = "u4";
}
impl Number for u64 {
    const DTYPE: &'static str = "u8";
}
// Numpy reads a truth value as a byte; arrays of them are never written by Python.
impl Number for bool {
    const DTYPE: &'static str = "?";
}
impl Number for u8 {
    const DTYPE: &'static str = "u1";
}

struct Address(*mut c_void);

// SAFETY: the address is only handed to Python. What lies there has an owner that is `Send` and `Sync`.
unsafe impl Send for Address {}
// SAFETY: as above.
unsafe impl Sync for Address {}

/// What has the memory, which stays where it is.
type Owner = Box<dyn Send + Sync>;

/// Numbers that a numpy array lies over. The array has this object, and this object what they lie in.
#[pyclass(frozen, module = "pairmask._pairmask")]
struct Memory {
    at: Address,
    bytes: usize,
    is_writable: bool,
    _owner: Owner,
}

/// A new numpy array: (n, N), or (n) where N is 1.
pub struct Array {
    memory: Memory,
    shape: Vec<usize>,
    dtype: &'static str,
}

impl Array {
    fn new<T: Number, const N: usize>(at: *mut [T; N], n: usize, owner: Owner) -> Self {
        let memory = Memory {
            at: Address(at.cast()),
            bytes: n * size_of::<[T; N]>(),
            is_writable: true,
            _owner: owner,
        };
        Self { memory, shape: if N == 1 { vec![n] } else { vec![n, N] }, dtype: T::DTYPE }
    }

    /// Rows that Python may write. They have to stay where they are, and nothing else may read or write them,
    /// until `owner` is dropped.
    pub fn over<T: Number, const N: usize>(rows: &mut [[T; N]], owner: Owner) -> Self {
        Self::new(rows.as_mut_ptr(), rows.len(), owner)
    }

    /// Rows that Python may write.
    pub fn writable<T: Number, const N: usize>(mut rows: Vec<[T; N]>) -> Self {
        Self::new(rows.as_mut_ptr(), rows.len(), Box::new(rows))
    }

    /// Rows that Python may only read.
    pub fn read_only<T: Number, const N: usize>(rows: Vec<[T; N]>) -> Self {
        let mut array = Self::writable(rows);
        array.memory.is_writable = false;
        array
    }
}

impl<'py> IntoPyObject<'py> for Array {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        let memory = Bound::new(py, self.memory)?;
        imported!(py, "numpy", "ndarray")?.call1((self.shape, self.dtype, memory))
    }
}

#[pymethods]
impl Memory {
    // The protocol fixes the signature.
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let this = slf.get();
        if view.is_null() {
            return Err(PyBufferError::new_err("no memory for a buffer"));
        }
        let (bytes, is_read_only) = (this.bytes as isize, c_int::from(!this.is_writable));
        // SAFETY: Python gives a valid pointer to a buffer. The buffer has this object, which has the memory.
        let failed = unsafe {
            ffi::PyBuffer_FillInfo(view, slf.as_ptr(), this.at.0, bytes, is_read_only, flags)
        };
        if failed == 0 { Ok(()) } else { Err(PyErr::fetch(slf.py())) }
    }
}
