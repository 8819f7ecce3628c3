//! Bytes that several threads compare or copy where they are many.

use rayon::prelude::*;

/// Bytes that a thread compares or copies at a time: few enough that a difference ends the comparison soon,
/// and enough that handing the task over does not count (25 µs each).
const TASK_BYTES: usize = 256 << 10;

/// From so many bytes on, threads share the work: it takes 0.2 ms on one.
const SHARED_BYTES: usize = 2 << 20;

/// Whether two ranges hold the same bytes. Stops at the first difference, or soon after. Where it
/// `is_shared`, the calling thread's pool takes part.
pub fn are_equal(a: &[u8], b: &[u8], is_shared: bool) -> bool {
    if a.len() != b.len() {
        return false;
    }
    if !is_shared || a.len() < SHARED_BYTES {
        return a.chunks(TASK_BYTES).eq(b.chunks(TASK_BYTES));
    }
    a.par_chunks(TASK_BYTES).zip(b.par_chunks(TASK_BYTES)).all(|(a, b)| a == b)
}

/// Copies items. Where it `is_shared`, the calling thread's pool takes part.
///
/// # Panics
/// Where `to` has more items or fewer.
pub fn copy<T: Copy + Send + Sync>(from: &[T], to: &mut [T], is_shared: bool) {
    if !is_shared || size_of_val(from) < SHARED_BYTES {
        return to.copy_from_slice(from);
    }
    assert_eq!(from.len(), to.len(), "as many items");
    let task_entries = TASK_BYTES / size_of::<T>();
    let tasks = to.par_chunks_mut(task_entries).zip(from.par_chunks(task_entries));
    tasks.for_each(|(to, from)| to.copy_from_slice(from));
}

/// Whether this thread is one of a pool: what it shares goes to that pool, and none is started for it.
pub fn is_in_pool() -> bool {
    rayon::current_thread_index().is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_anywhere_is_a_difference() {
        for len in [1, 24, TASK_BYTES, TASK_BYTES + 1, SHARED_BYTES + 24, 5 * TASK_BYTES - 7] {
            let a: Vec<u8> = (0..len).map(|i| (i * 7) as u8).collect();
            let mut b = a.clone();
            for is_shared in [false, true] {
                assert!(are_equal(&a, &b, is_shared), "{len}");
                for at in [0, len / 3, len - 1] {
                    b[at] ^= 0x80;
                    assert!(!are_equal(&a, &b, is_shared), "{len} at {at}");
                    b[at] ^= 0x80;
                }
                assert!(!are_equal(&a, &b[..len - 1], is_shared), "{len} and one less");
            }
        }
        assert!(are_equal(&[], &[], true));
    }

    #[test]
    fn a_copy_in_parts_is_whole() {
        for len in [0, 1, 1_000, SHARED_BYTES / 4 + 3] {
            let from: Vec<u32> = (0..len as u32).map(|i| i ^ 0x5a5a).collect();
            for is_shared in [false, true] {
                let mut to = vec![u32::MAX; len];
                copy(&from, &mut to, is_shared);
                assert!(to == from, "{len}");
            }
        }
    }
}
