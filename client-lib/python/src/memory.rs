//! Memory that Python reads or writes where it lies, through the buffer protocol.
//!
//! All `unsafe` code of the extension is here. It relies on three facts: a [`Memory`] owns what keeps its
//! address valid, an address and its dimensions never change while the object lives, and every buffer that
//! Python holds keeps the object alive.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_int, c_void};
use std::ptr;

use pyo3::exceptions::PyBufferError;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// A number that numpy knows by the format of a buffer.
pub trait Number: Copy + Send + Sync + 'static {
    /// Its format, in the letters of Python's `struct`.
    const FORMAT: &'static CStr;
}

impl Number for f32 {
    const FORMAT: &'static CStr = c"f";
}
impl Number for u32 {
    const FORMAT: &'static CStr = c"I";
}
impl Number for u8 {
    const FORMAT: &'static CStr = c"B";
}

/// Rows of numbers at an address.
#[derive(Clone, Copy)]
struct Address(*mut c_void);

// SAFETY: the address is only handed to Python. What lies there is kept by an owner that is `Send` and `Sync`.
unsafe impl Send for Address {}
// SAFETY: as above.
unsafe impl Sync for Address {}

/// Numbers that numpy arrays lie over. An array keeps this object, and this object keeps what the numbers lie in.
#[pyclass(frozen, module = "pairmask._pairmask")]
pub struct Memory {
    at: Address,
    format: &'static CStr,
    item_bytes: isize,
    is_writable: bool,
    /// Lengths and strides; the first `dimensions` of each count.
    shape: [isize; 2],
    strides: [isize; 2],
    dimensions: usize,
    _owner: Box<dyn Send + Sync>,
}

impl Memory {
    fn new<T: Number>(at: *mut T, shape: &[usize], is_writable: bool, owner: Owner) -> Self {
        let item_bytes = size_of::<T>() as isize;
        let mut lengths = [1; 2];
        for (to, from) in lengths.iter_mut().zip(shape) {
            *to = *from as isize;
        }
        let strides = match shape.len() {
            1 => [item_bytes; 2],
            _ => [item_bytes * lengths[1], item_bytes],
        };
        let at = Address(at.cast());
        let dimensions = shape.len();
        Self {
            at,
            format: T::FORMAT,
            item_bytes,
            is_writable,
            shape: lengths,
            strides,
            dimensions,
            _owner: owner,
        }
    }

    /// Rows that Python may only read.
    pub fn of_rows<T: Number, const N: usize>(rows: Vec<[T; N]>) -> Self {
        let (at, len) = (rows.as_ptr().cast::<T>().cast_mut(), rows.len());
        Self::new(at, &[len, N], false, Box::new(rows))
    }

    /// Numbers that Python may only read.
    pub fn of_numbers<T: Number>(numbers: Vec<T>) -> Self {
        let (at, len) = (numbers.as_ptr().cast_mut(), numbers.len());
        Self::new(at, &[len], false, Box::new(numbers))
    }

    /// Rows that Python may write. They have to stay where they are, and nothing else may read or write them,
    /// until `owner` is dropped.
    pub fn of_writable<T: Number, const N: usize>(rows: &mut [[T; N]], owner: Owner) -> Self {
        let (at, len) = (rows.as_mut_ptr().cast::<T>(), rows.len());
        Self::new(at, &[len, N], true, owner)
    }

    /// A numpy array over this memory.
    pub fn into_array(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        static AS_ARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        AS_ARRAY.import(py, "numpy", "asarray")?.call1((Bound::new(py, self)?,))
    }
}

/// What keeps memory where it is.
pub type Owner = Box<dyn Send + Sync>;

#[pymethods]
impl Memory {
    // The protocol fixes the signature.
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let this = slf.get();
        let asks = |flag: c_int| flags & flag == flag;
        if view.is_null() {
            return Err(PyBufferError::new_err("no place for a buffer"));
        }
        if asks(ffi::PyBUF_WRITABLE) && !this.is_writable {
            return Err(PyBufferError::new_err("this memory may only be read"));
        }
        if asks(ffi::PyBUF_F_CONTIGUOUS) && this.dimensions > 1 {
            return Err(PyBufferError::new_err("this memory lies row by row"));
        }
        let items: isize = this.shape[..this.dimensions].iter().product();
        let filled = ffi::Py_buffer {
            buf: this.at.0,
            obj: ptr::null_mut(),
            len: items * this.item_bytes,
            itemsize: this.item_bytes,
            readonly: c_int::from(!this.is_writable),
            ndim: this.dimensions as c_int,
            format: if asks(ffi::PyBUF_FORMAT) {
                this.format.as_ptr().cast_mut()
            } else {
                ptr::null_mut()
            },
            // Nobody writes through these: the protocol says so.
            shape: if asks(ffi::PyBUF_ND) {
                this.shape.as_ptr().cast_mut()
            } else {
                ptr::null_mut()
            },
            strides: if asks(ffi::PyBUF_STRIDES) {
                this.strides.as_ptr().cast_mut()
            } else {
                ptr::null_mut()
            },
            suboffsets: ptr::null_mut(),
            internal: ptr::null_mut(),
        };
        // SAFETY: Python gives a valid place for a buffer. It may be uninitialised, so that it is written as a
        // whole. Shape and strides lie in the object, which does not move and which `obj` keeps alive.
        unsafe {
            view.write(filled);
            (*view).obj = slf.into_ptr();
        }
        Ok(())
    }
}
