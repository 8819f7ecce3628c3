//! Whether the comparison is sooner done than a cull.

use crate::objects::Objects;

/// What a thread compares in a nanosecond, bytes of objects: a core reads two ranges that no cache holds at
/// 10 GB/s each (measured on two x86-64 servers). A larger constant would have hosts compare frames that a
/// GPU culls sooner.
const BYTES_A_NS: f64 = 10.0;

/// Threads beyond these compare no faster: they share the memory.
const MOST_THREADS: usize = 8;

/// Bytes of mask that are expected an object: a pair in a list.
const MASK_BYTES: usize = 8;

/// Whether so many objects are compared, and their answer copied, sooner than an engine that is predicted
/// to take `engine_ns` culls them. Engines of a CPU always take longer; a GPU that reads the boxes where
/// they lie may not.
pub fn is_sooner_compared(objects: Objects<'_>, threads: usize, engine_ns: u64) -> bool {
    let bytes = objects.len() * (objects.form().object_bytes() + MASK_BYTES);
    let rate = BYTES_A_NS * threads.clamp(1, MOST_THREADS) as f64;
    (bytes as f64 / rate) < engine_ns as f64
}
