//! Memory on huge pages: what is read in no order there misses the caches for the memory alone, and not for
//! its addresses as well.
#![allow(unsafe_code)]

/// Bytes from which that pays: two huge pages of x86-64. Addresses of less are known to the processor anyway.
const LEAST_BYTES: usize = 4 << 20;

/// Asks for huge pages behind the memory of a vector, where there is much of it. Pages that were written before
/// stay as they are, so do it before. Where the system has no huge pages, nothing changes.
#[inline]
pub(crate) fn prefer<T>(memory: &Vec<T>) {
    let bytes = memory.capacity() * size_of::<T>();
    if bytes >= LEAST_BYTES {
        advise(memory.as_ptr().cast(), bytes);
    }
}

#[cfg(target_os = "linux")]
fn advise(start: *const u8, bytes: usize) {
    use std::ffi::{c_int, c_void};

    /// The same number on every processor.
    const MADV_HUGEPAGE: c_int = 14;
    /// Pages are 64 KiB or smaller: the start of a larger one would be refused, which is no harm.
    const PAGE: usize = 64 << 10;

    // SAFETY: std links the C library, whose declaration this is.
    unsafe extern "C" {
        fn madvise(start: *mut c_void, bytes: usize, advice: c_int) -> c_int;
    }

    let skipped = start.addr().wrapping_neg() % PAGE;
    let first_page = start.wrapping_add(skipped).cast_mut().cast::<c_void>();
    // SAFETY: the range lies in memory that a vector owns. This advice changes which pages stand behind it, and
    // nothing that they hold.
    let _refused = unsafe { madvise(first_page, bytes - skipped, MADV_HUGEPAGE) };
}

#[cfg(not(target_os = "linux"))]
const fn advise(_: *const u8, _: usize) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_memory_holds_stays() {
        let count = 2 * LEAST_BYTES / size_of::<u64>() + 1;
        let mut words = Vec::with_capacity(count);
        words.extend(0..count as u64 / 2);
        prefer(&words);
        words.extend(count as u64 / 2..count as u64);
        assert!(words.into_iter().eq(0..count as u64));
    }
}
