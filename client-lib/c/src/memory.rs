//! What lies behind the pointers of a call: the one module that trusts them.
//!
//! The head of the header states what a program promises of every pointer: it is null or aligned, and valid for
//! as many values as are said beside it, which nobody else uses meanwhile. Only programs make an [`In`] or an
//! [`Out`], so that the promise holds for each of them. All else that can be wrong with it is checked here.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};

use bytemuck::AnyBitPattern;

use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;

/// Where a program has values: a `const T *`.
#[derive(Clone, Copy, Debug, Default)]
#[repr(transparent)]
pub struct In<T>(*const T);

/// Where a program gets a result: a `T *`.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Out<T>(*mut T);

impl<T: AnyBitPattern> In<T> {
    /// The values of an array, for as long as the program's promise holds: until the call returns, or, where a
    /// function documents it, until the edit is answered. It may be null where there are none.
    pub fn array(self, count: usize) -> Result<&'static [T], Failure> {
        if count == 0 {
            return Ok(&[]);
        }
        check(self.0, count)?;
        // SAFETY: the pointer is neither null nor misaligned, and the bytes do not exceed `isize::MAX`, which was
        // checked; that the values are there is the program's promise. Every bit pattern is a value.
        Ok(unsafe { std::slice::from_raw_parts(self.0, count) })
    }

    /// A single value.
    pub fn value(self) -> Result<T, Failure> {
        Ok(self.array(1)?[0])
    }

    /// A single value; `None` where the pointer is null.
    pub fn if_any(self) -> Result<Option<T>, Failure> {
        (!self.0.is_null()).then(|| self.value()).transpose()
    }
}

impl In<c_char> {
    /// A text that ends with a zero; `None` where the pointer is null.
    pub fn text(self) -> Result<Option<&'static str>, Failure> {
        if self.0.is_null() {
            return Ok(None);
        }
        // SAFETY: it is not null, and ends with a zero by the program's promise.
        let text = unsafe { CStr::from_ptr(self.0) };
        text.to_str().map(Some).map_err(|_| Failure::argument("a text is no UTF-8"))
    }
}

/// A struct that may grow.
///
/// # Safety
/// It is `repr(C)`, its first field is its size, a `usize`, and every bit pattern is a value of it.
pub unsafe trait Growing: Copy + Default {}

/// Lets a struct grow whose first field is its size, and all of whose fields are numbers and pointers.
macro_rules! growing {
    ($of:ty) => {
        const _: () = assert!(std::mem::offset_of!($of, struct_size) == 0);
        // SAFETY: it is `repr(C)` and begins with its size; numbers and pointers have no invalid bit patterns.
        unsafe impl crate::memory::Growing for $of {}
    };
}

impl<T: Growing> In<T> {
    /// As many bytes as its `struct_size` says, the rest zeros, as which a null pointer counts.
    pub fn growing(self) -> Result<T, Failure> {
        let mut value = T::default();
        if !self.0.is_null() {
            let size = checked_size(self.0)?;
            // SAFETY: so many bytes are there by the program's promise, and `value`, which has as many, does not
            // overlap them. Regardless of what they are, they are a value.
            unsafe { self.0.cast::<u8>().copy_to_nonoverlapping((&raw mut value).cast(), size) };
        }
        Ok(value)
    }
}

impl<T: Copy> Out<T> {
    /// That a result can be written there, before anything is done for it.
    pub fn check(self) -> Result<(), Failure> {
        check(self.0, 1)
    }

    /// Where the program gets the result; `None` if it gets none.
    pub fn if_any(self) -> Option<Self> {
        (!self.0.is_null()).then_some(self)
    }

    /// Writes a result.
    pub fn write(self, value: T) -> Result<(), Failure> {
        self.check()?;
        // SAFETY: it is neither null nor misaligned, which was checked; that it is valid is the program's promise.
        unsafe { self.0.write(value) };
        Ok(())
    }

    /// Does the work of a function with one result.
    pub fn give(self, work: impl FnOnce() -> Result<T, Failure>) -> pm_code {
        call(|| {
            self.check()?;
            self.write(work()?)
        })
    }
}

impl<T> Out<*const T> {
    /// Does the work of a function that writes where a list lies and how long it is.
    pub fn give_list(
        self,
        count: Out<usize>,
        find: impl FnOnce() -> Result<(*const T, usize), Failure>,
    ) -> pm_code {
        call(|| {
            self.check()?;
            count.check()?;
            let (memory, len) = find()?;
            self.write(memory)?;
            count.write(len)
        })
    }
}

impl<T: Growing> Out<T> {
    /// That facts can be written there, before anything is done for them.
    pub fn check_growing(self) -> Result<(), Failure> {
        checked_size(self.0).map(|_| ())
    }

    /// Writes as many bytes as the program's `struct_size` says, which stays as it is.
    pub fn write_growing(self, value: &T) -> Result<(), Failure> {
        let size = checked_size(self.0)?;
        // SAFETY: so many bytes are there by the program's promise, of which the first are the size; `value` is
        // this library's own, has as many, and does not overlap them.
        unsafe {
            let behind_size = (&raw const *value).cast::<u8>().add(size_of::<usize>());
            let out = self.0.cast::<u8>().add(size_of::<usize>());
            out.copy_from_nonoverlapping(behind_size, size - size_of::<usize>());
        }
        Ok(())
    }

    /// Does the work of a function that writes facts.
    pub fn give_growing(self, work: impl FnOnce() -> Result<T, Failure>) -> pm_code {
        call(|| {
            self.check_growing()?;
            self.write_growing(&work()?)
        })
    }
}

/// Where a list lies, and how long it is.
pub fn raw<T>(list: &[T]) -> (*const T, usize) {
    (list.as_ptr(), list.len())
}

/// The part of a program's struct that both sides know.
fn checked_size<T: Growing>(pointer: *const T) -> Result<usize, Failure> {
    check(pointer, 1)?;
    let size = In(pointer.cast::<usize>()).value()?;
    if size < size_of::<usize>() {
        return Err(Failure::argument("struct_size is not set"));
    }
    Ok(size.min(size_of::<T>()))
}

fn check<T>(pointer: *const T, count: usize) -> Result<(), Failure> {
    if pointer.is_null() {
        return Err(Failure::argument("a pointer is null"));
    }
    if !pointer.is_aligned() {
        return Err(Failure::argument("a pointer is not aligned"));
    }
    let bytes = size_of::<T>().checked_mul(count);
    if bytes.is_none_or(|bytes| isize::try_from(bytes).is_err()) {
        return Err(Failure::argument("an array is longer than memory"));
    }
    Ok(())
}
