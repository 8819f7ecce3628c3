//! Memory asked for before it is needed, so that several misses of the caches are under way at a time.
#![allow(unsafe_code)]

/// Asks for the line of an item. An item beyond the slice is no harm.
#[inline(always)]
pub(crate) fn ask_for<T>(slice: &[T], at: u32) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let entry = slice.as_ptr().wrapping_add(at as usize).cast::<i8>();
        // SAFETY: to fetch ahead has no effect that a program can see, regardless of the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(entry) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, at);
}
