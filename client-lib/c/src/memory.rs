//! What lies behind the pointers of a call: the one place that trusts them.
//!
//! The head of the header states what a caller promises of every pointer: it is null or aligned, and valid for
//! as many values as are said beside it. Whatever else can be wrong with it is checked here.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};

use bytemuck::{AnyBitPattern, NoUninit};

use crate::failure::Failure;

/// The values of an array, for as long as the caller's promise holds: until the call returns, or, where a
/// function says so, until the edit is answered. None may be null where there are none.
///
/// # Safety
/// `pointer` is null or aligned, and valid for `count` values that nobody writes meanwhile.
pub unsafe fn array<T: AnyBitPattern>(
    pointer: *const T,
    count: usize,
) -> Result<&'static [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    check_count::<T>(pointer.is_null(), pointer.is_aligned(), count)?;
    // SAFETY: `pointer` is neither null nor misaligned, and the bytes do not exceed `isize::MAX`, which was
    // checked; that the values are there is the caller's promise. Every bit pattern is a value.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// A single value.
///
/// # Safety
/// As [`array`], for one value.
pub unsafe fn value<T: AnyBitPattern>(pointer: *const T) -> Result<T, Failure> {
    // SAFETY: the caller's promise is passed on.
    let one = unsafe { array(pointer, 1) }?;
    Ok(one[0])
}

/// Writes a result.
///
/// # Safety
/// `out` is null or aligned, and valid for a value that nobody else uses.
pub unsafe fn write<T>(out: *mut T, value: T) -> Result<(), Failure> {
    check_out(out)?;
    // SAFETY: `out` is neither null nor misaligned, which was checked; that it is valid is the caller's
    // promise.
    unsafe { out.write(value) };
    Ok(())
}

/// That a result can be written there, before anything is done for it.
pub fn check_out<T>(out: *mut T) -> Result<(), Failure> {
    check_count::<T>(out.is_null(), out.is_aligned(), 1)
}

/// Writes where a list lies and how long it is, once `find` has found it.
///
/// # Safety
/// As [`write`], for both results.
pub unsafe fn write_list<T>(
    list: *mut *const T,
    count: *mut usize,
    find: impl FnOnce() -> Result<(*const T, usize), Failure>,
) -> Result<(), Failure> {
    check_out(list)?;
    check_out(count)?;
    let (memory, len) = find()?;
    // SAFETY: the caller's promise is passed on.
    unsafe {
        write(list, memory)?;
        write(count, len)
    }
}

/// A text that ends with a zero; `None` where the pointer is null.
///
/// # Safety
/// `text` is null, or valid up to a zero byte that nobody writes meanwhile.
pub unsafe fn text(text: *const c_char) -> Result<Option<&'static str>, Failure> {
    if text.is_null() {
        return Ok(None);
    }
    // SAFETY: it is not null, and ends with a zero by the caller's promise.
    let text = unsafe { CStr::from_ptr(text) };
    let utf8 = text.to_str().map_err(|_| Failure::argument("a text is no UTF-8"))?;
    Ok(Some(utf8))
}

/// A struct that may grow.
///
/// # Safety
/// It is `repr(C)`, its first field is its size, a `usize`, and every bit pattern is a value of it.
pub unsafe trait Growing: Copy {}

/// Reads a struct that may grow: as many bytes as its `struct_size` says, the rest as in `default`, which is
/// what a null pointer stands for.
///
/// # Safety
/// `pointer` is null or aligned, and valid for as many bytes as its first field says.
pub unsafe fn growing<T: Growing>(pointer: *const T, mut default: T) -> Result<T, Failure> {
    if pointer.is_null() {
        return Ok(default);
    }
    check_count::<T>(false, pointer.is_aligned(), 1)?;
    // SAFETY: every struct that grows begins with its size; the caller's promise is passed on.
    let size = unsafe { value(pointer.cast::<usize>()) }?;
    let size = checked_size::<T>(size)?;
    // SAFETY: so many bytes are there by the caller's promise, and `default`, which has as many, does not
    // overlap them. Whatever they are, they are a value.
    unsafe { pointer.cast::<u8>().copy_to_nonoverlapping((&raw mut default).cast(), size) };
    Ok(default)
}

/// Writes a struct that may grow: as many bytes as its `struct_size` says, which stays as it is.
///
/// # Safety
/// `out` is null or aligned, and valid for as many bytes as its first field says.
pub unsafe fn write_growing<T: NoUninit>(out: *mut T, value: &T) -> Result<(), Failure> {
    check_out(out)?;
    // SAFETY: every struct that grows begins with its size; the caller's promise is passed on.
    let size = unsafe { self::value(out.cast::<usize>().cast_const()) }?;
    let size = checked_size::<T>(size)?;
    let bytes = &bytemuck::bytes_of(value)[size_of::<usize>()..size];
    // SAFETY: so many bytes are there by the caller's promise, and `value` is this library's own, which
    // does not overlap them.
    unsafe {
        let behind_size = out.cast::<u8>().add(size_of::<usize>());
        behind_size.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
    }
    Ok(())
}

/// The part of a struct that both sides know.
fn checked_size<T>(size: usize) -> Result<usize, Failure> {
    if size < size_of::<usize>() {
        return Err(Failure::argument("struct_size is not set"));
    }
    Ok(size.min(size_of::<T>()))
}

fn check_count<T>(is_null: bool, is_aligned: bool, count: usize) -> Result<(), Failure> {
    if is_null {
        return Err(Failure::argument("a pointer is null"));
    }
    if !is_aligned {
        return Err(Failure::argument("a pointer is not aligned"));
    }
    let bytes = size_of::<T>().checked_mul(count);
    if bytes.is_none_or(|bytes| isize::try_from(bytes).is_err()) {
        return Err(Failure::argument("an array is longer than memory"));
    }
    Ok(())
}
