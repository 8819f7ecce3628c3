//! Buffers that are reused.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pairmask_core::aabb::Aabb;
use pairmask_core::engine::HeapReply;
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_core::usable_memory;

/// Memory from this size on is compared with what the process may use, which takes the reading of some files.
const LARGE_BYTES: u64 = 64 << 20;
/// Buffers of each kind that are kept for reuse: those of two frames under way and of one being
/// filled, and one of a mask that is held.
const KEPT_BUFFERS: usize = 4;

/// Spare buffers of one session.
#[derive(Default)]
pub struct Spares {
    pub boxes: Shelf<Vec<Aabb>>,
    pub spheres: Shelf<Vec<Sphere>>,
    pub replies: Shelf<HeapReply>,
    /// Memory for what queries find, so that it is not mapped for each anew.
    pub found: Shelf<Vec<[u32; 2]>>,
}

impl std::fmt::Debug for Spares {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Spares")
    }
}

/// A few buffers for reuse.
pub struct Shelf<T>(Mutex<Vec<T>>);

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::with_capacity(KEPT_BUFFERS)))
    }
}

impl<T: Default> Shelf<T> {
    pub(super) fn take(&self) -> T {
        lock(&self.0).pop().unwrap_or_default()
    }

    /// Keeps a buffer, unless [`KEPT_BUFFERS`] are kept.
    pub(super) fn give(&self, entry: T) {
        let mut kept = lock(&self.0);
        if kept.len() < KEPT_BUFFERS {
            kept.push(entry);
        }
    }
}

impl<T: Clone + Default> Shelf<Vec<T>> {
    /// Memory for `n` items, contents unspecified; `None` where the system has none.
    pub(super) fn take_sized(&self, n: BoxCount) -> Option<Vec<T>> {
        let mut entries = self.take();
        // A system that lends more than it has kills the process that touches it. An engine needs as much again.
        let bytes = size_of::<T>() as u64 * u64::from(n.get());
        let is_too_much = |usable| 2 * bytes > usable;
        let is_new = n.len() > entries.capacity();
        if is_new && bytes > LARGE_BYTES && usable_memory::bytes().is_some_and(is_too_much) {
            return None;
        }
        entries.try_reserve_exact(n.len().saturating_sub(entries.len())).ok()?;
        entries.resize(n.len(), T::default());
        Some(entries)
    }
}

/// Locks a mutex, a poisoned one too: the next frame overwrites the scratch memory that a panicking
/// engine left.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
