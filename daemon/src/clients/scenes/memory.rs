//! How much memory all scenes together may take.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of a pair.
const BYTES_A_PAIR: u64 = 8;

/// The memory of all scenes of a daemon.
#[derive(Clone, Debug)]
pub(crate) struct SceneMemory(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    limit: u64,
    used: AtomicU64,
    scenes: AtomicU64,
}

/// There is no room for a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "scenes would take {needed_bytes} bytes, and may take {limit_bytes}: serve with a larger --max-scene-mib"
)]
pub(crate) struct NoRoom {
    /// What all scenes together would take.
    pub(crate) needed_bytes: u64,
    /// What they may take.
    pub(crate) limit_bytes: u64,
}

impl SceneMemory {
    /// At most so many bytes.
    pub(crate) fn new(limit: u64) -> Self {
        Self(Arc::new(Shared { limit, used: AtomicU64::new(0), scenes: AtomicU64::new(0) }))
    }

    /// Memory of a new scene.
    ///
    /// # Errors
    /// [`NoRoom`].
    pub(crate) fn charge(&self, bytes: u64) -> Result<Charge, NoRoom> {
        self.0.take(bytes)?;
        self.0.scenes.fetch_add(1, Ordering::Relaxed);
        Ok(Charge { of: Arc::clone(&self.0), bytes })
    }

    /// Most pairs that a search among all boxes of a scene may find, where an answer has room for so many: as many as
    /// all scenes may take memory for, since rules leave few of them in the answer.
    pub(crate) fn most_pairs(&self, of_answer: u64) -> u64 {
        of_answer.max(self.0.limit / BYTES_A_PAIR)
    }

    /// Scenes, and the bytes that they take.
    pub(crate) fn used(&self) -> (u64, u64) {
        (self.0.scenes.load(Ordering::Relaxed), self.0.used.load(Ordering::Relaxed))
    }
}

impl Shared {
    fn take(&self, bytes: u64) -> Result<(), NoRoom> {
        let needed = |used: u64| used.saturating_add(bytes);
        let more = |used| (needed(used) <= self.limit).then(|| needed(used));
        let taken = self.used.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more);
        let no_room = |used| NoRoom { needed_bytes: needed(used), limit_bytes: self.limit };
        taken.map(drop).map_err(no_room)
    }
}

/// Memory of a scene. It goes back with the scene.
#[derive(Debug)]
pub(crate) struct Charge {
    of: Arc<Shared>,
    bytes: u64,
}

impl Charge {
    /// Takes more, so that it is at least so much.
    ///
    /// # Errors
    /// [`NoRoom`]; it stays what it was.
    pub(crate) fn grow_to(&mut self, bytes: u64) -> Result<(), NoRoom> {
        if let Some(more) = bytes.checked_sub(self.bytes) {
            self.of.take(more)?;
            self.bytes = bytes;
        }
        Ok(())
    }

    /// The largest number of copies, from `most` down to one, whose bytes there is room for; one where there is none.
    pub(crate) fn most_that_fit(&self, most: usize, bytes: impl Fn(usize) -> u64) -> usize {
        let others = self.of.used.load(Ordering::Relaxed).saturating_sub(self.bytes);
        let fits = |copies: &usize| others.saturating_add(bytes(*copies)) <= self.of.limit;
        (1..=most).rev().find(fits).unwrap_or(1)
    }

    /// Notes how much it is by now.
    pub(crate) fn set(&mut self, bytes: u64) {
        self.of.used.fetch_add(bytes, Ordering::Relaxed);
        self.of.used.fetch_sub(self.bytes, Ordering::Relaxed);
        self.bytes = bytes;
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.of.used.fetch_sub(self.bytes, Ordering::Relaxed);
        self.of.scenes.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_several_gpus_is_kept_on_fewer() {
        let memory = SceneMemory::new(100);
        let (mut one, two) = (memory.charge(10).expect("room"), memory.charge(20).expect("room"));
        let bytes = |copies: usize| 30 * copies as u64;
        assert_eq!([1, 2, 3, 4].map(|most| one.most_that_fit(most, bytes)), [1, 2, 2, 2]);
        drop(two);
        assert_eq!(one.most_that_fit(4, bytes), 3);
        assert!(one.grow_to(bytes(3)).is_ok() && one.grow_to(bytes(4)).is_err());
        assert_eq!(one.most_that_fit(4, |_| 101), 1, "which is refused");
    }

    #[test]
    fn scenes_take_no_more_than_they_may_and_give_it_back() {
        let memory = SceneMemory::new(100);
        let mut one = memory.charge(40).expect("room");
        let two = memory.charge(50).expect("room");
        assert_eq!(memory.used(), (2, 90));
        let refused = one.grow_to(51).expect_err("101 of 100");
        assert_eq!(refused, NoRoom { needed_bytes: 101, limit_bytes: 100 });
        assert!(one.grow_to(30).is_ok() && one.grow_to(50).is_ok());
        assert!(memory.charge(1).is_err());
        drop(two);
        one.set(120);
        assert_eq!(memory.used(), (1, 120), "what is known afterwards may be more");
        assert!(memory.charge(0).is_err());
        drop(one);
        assert_eq!(memory.used(), (0, 0));
        assert!(memory.charge(u64::MAX).is_err());
    }
}
