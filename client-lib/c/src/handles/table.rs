//! The table of all objects: the one state of the process that a C ABI needs, since an id says nothing of where
//! its object lies.
//!
//! An id is a generation in its high half and a place, from 1, in its low half. A place that is freed has
//! another generation, so that an id of what was dropped names nothing. A look-up takes no lock but that of
//! the place, and does not wait for that one: 10 ns.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError, TryLockError};

use super::{Handle, Object};
use crate::code::pm_code::{PM_ERR_BUSY, PM_ERR_HANDLE, PM_ERR_TOO_MANY_HANDLES};
use crate::failure::Failure;

/// Places of the first chunk; each chunk has twice as many as the one before. A program with few objects
/// takes 20 KiB.
const FIRST_CHUNK: u32 = 64;
/// Chunks: 64 · (2^24 − 1) places, more than memory holds objects.
const CHUNKS: usize = 24;

/// A place of the table.
#[derive(Default)]
struct Place {
    /// That of the object, or of the next one. Even while the place is free. It changes with the object, and
    /// can be read while another call holds that: an id of old names nothing then, and is not busy.
    generation: AtomicU32,
    object: Mutex<Option<Object>>,
}

impl Place {
    /// Relaxed: it changes under the object's lock, and whoever has an id of old has seen the change that made it so.
    fn generation(&self) -> u32 {
        self.generation.load(Ordering::Relaxed)
    }

    /// Of an object that comes or goes, whose lock is held. What it is from now on.
    fn next_generation(&self) -> u32 {
        self.generation.fetch_add(1, Ordering::Relaxed) + 1
    }
}

/// Places that are free.
struct Free {
    /// Those that had an object.
    used: Vec<u32>,
    /// Those from here on never had one.
    next: u32,
}

struct Table {
    chunks: [OnceLock<Box<[Place]>>; CHUNKS],
    free: Mutex<Free>,
}

static TABLE: Table = Table::new();

const NOTHING: Failure = Failure::new(
    PM_ERR_HANDLE,
    "the handle names nothing: it is zero, was dropped, or is of another kind",
);

/// The chunk of a place, and the place in it.
const fn chunk_of(place: u32) -> (usize, usize) {
    let from_start = place as u64 + FIRST_CHUNK as u64;
    let chunk = from_start.ilog2() - FIRST_CHUNK.ilog2();
    (chunk as usize, (from_start - ((FIRST_CHUNK as u64) << chunk)) as usize)
}

impl Table {
    const fn new() -> Self {
        Self {
            chunks: [const { OnceLock::new() }; CHUNKS],
            free: Mutex::new(Free { used: Vec::new(), next: 0 }),
        }
    }

    fn free(&self) -> MutexGuard<'_, Free> {
        // Nothing panics with it half changed.
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The place of an id that an object may have, and what lies there.
    fn held(&self, id: u64) -> Result<(&Place, MutexGuard<'_, Option<Object>>), Failure> {
        let (place, generation) = ((id as u32).wrapping_sub(1), (id >> 32) as u32);
        let (chunk, at) = chunk_of(place);
        let places = self.chunks.get(chunk).and_then(OnceLock::get).ok_or(NOTHING)?;
        let place = &places[at];
        if place.generation() != generation {
            return Err(NOTHING);
        }
        let object = match place.object.try_lock() {
            Ok(object) => object,
            Err(TryLockError::WouldBlock) => {
                let text = "another call uses the handle: a session and what comes of it belong to one thread at a time";
                return Err(Failure::new(PM_ERR_BUSY, text));
            }
            Err(TryLockError::Poisoned(_)) => {
                return Err(Failure::new(PM_ERR_HANDLE, "a call with this handle has panicked"));
            }
        };
        if place.generation() == generation && object.is_some() {
            Ok((place, object))
        } else {
            Err(NOTHING)
        }
    }

    /// A place without an object.
    fn take_place(&self) -> Option<u32> {
        let mut free = self.free();
        if let Some(place) = free.used.pop() {
            return Some(place);
        }
        let place = free.next;
        let (chunk, _) = chunk_of(place);
        let places = (FIRST_CHUNK as usize) << chunk;
        self.chunks.get(chunk)?.get_or_init(|| (0..places).map(|_| Place::default()).collect());
        free.next += 1;
        Some(place)
    }
}

/// The id of a new object.
pub fn insert(object: Object) -> Result<u64, Failure> {
    let too_many = Failure::new(PM_ERR_TOO_MANY_HANDLES, "more live handles than there are ids");
    let place = TABLE.take_place().ok_or(too_many)?;
    let (chunk, at) = chunk_of(place);
    let places = TABLE.chunks[chunk].get().ok_or(NOTHING)?;
    // A call with an old id may look at the place just now: it lets go at once.
    let mut held = places[at].object.lock().map_err(|_| NOTHING)?;
    *held = Some(object);
    Ok(u64::from(places[at].next_generation()) << 32 | u64::from(place + 1))
}

/// Uses the object of a handle.
pub fn with<H: Handle, R>(
    handle: H,
    work: impl FnOnce(&mut H::Named) -> Result<R, Failure>,
) -> Result<R, Failure> {
    let (_, mut held) = TABLE.held(handle.id())?;
    work(held.as_mut().and_then(H::of).ok_or(NOTHING)?)
}

/// Takes the object of a handle.
pub fn remove<H: Handle>(handle: H) -> Result<H::Named, Failure> {
    let id = handle.id();
    let (place, mut held) = TABLE.held(id)?;
    held.as_mut().and_then(H::of).ok_or(NOTHING)?;
    let object = held.take().and_then(H::take).ok_or(NOTHING)?;
    // A place whose generations are used up is never used again.
    let is_spent = place.next_generation() == u32::MAX - 1;
    drop(held);
    if !is_spent {
        TABLE.free().used.push((id as u32) - 1);
    }
    Ok(object)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use pairmask::filters::Rules;

    use super::*;
    use crate::code::pm_code::{PM_ERR_PANIC, PM_OK};
    use crate::rules::pm_rules;
    use crate::session::pm_session;

    #[test]
    fn chunks_follow_each_other() {
        let mut expected = 0;
        for chunk in 0..4 {
            for at in 0..(FIRST_CHUNK as usize) << chunk {
                assert_eq!(chunk_of(expected), (chunk, at));
                expected += 1;
            }
        }
        assert!(chunk_of(u32::MAX).0 >= CHUNKS, "the largest place has no chunk");
    }

    #[test]
    fn an_id_of_what_was_dropped_or_is_of_another_kind_names_nothing() {
        let rules = pm_rules::new(Arc::new(Rules::default())).expect("a place");
        assert_eq!(pm_session { id: rules.id }.drop(), PM_ERR_HANDLE, "another kind");
        assert_eq!(rules.drop(), PM_OK);
        assert_eq!(rules.drop(), PM_ERR_HANDLE, "dropped twice");
        let next = pm_rules::new(Arc::new(Rules::default())).expect("a place");
        assert_ne!(rules.id, next.id);
        assert!(rules.with(|_| Ok(())).is_err(), "the place may be that of another object now");
        assert_eq!(next.drop(), PM_OK);
        for id in [1, u64::MAX, 1 << 32, u64::from(u32::MAX)] {
            assert!(pm_rules { id }.with(|_| Ok(())).is_err(), "{id:#x}");
        }
        assert_eq!(pm_rules { id: 0 }.drop(), PM_OK, "zero is null");
    }

    #[test]
    fn a_handle_in_use_is_busy_and_one_that_panicked_is_spent() {
        let rules = pm_rules::new(Arc::new(Rules::default())).expect("a place");
        rules
            .with(|_| {
                let other = rules.with(|_| Ok(())).expect_err("in use");
                assert_eq!(other.code, PM_ERR_BUSY);
                Ok(())
            })
            .expect("free");
        let code = crate::call::call(|| rules.with(|_| panic!("as a bug would")));
        assert_eq!(code, PM_ERR_PANIC);
        assert_eq!(rules.drop(), PM_ERR_HANDLE);
    }

    #[test]
    fn an_id_of_old_is_not_busy_while_another_call_holds_its_place() {
        let table = Table::new();
        let number = table.take_place().expect("a place");
        let place = &table.chunks[0].get().expect("places")[number as usize];
        let object = place.object.lock().expect("no call has panicked");
        let id = u64::from(place.next_generation()) << 32 | u64::from(number + 1);
        assert_eq!(table.held(id).map(|_| ()).expect_err("in use").code, PM_ERR_BUSY);
        place.next_generation();
        assert_eq!(table.held(id).map(|_| ()).expect_err("of old").code, PM_ERR_HANDLE);
        drop(object);
    }

    #[test]
    fn many_threads_make_and_drop() {
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..1_000 {
                        let rules = pm_rules::new(Arc::new(Rules::default())).expect("a place");
                        let other = pm_rules::new(Arc::new(Rules::default())).expect("a place");
                        assert_ne!(rules.id, other.id);
                        assert_eq!((rules.drop(), other.drop()), (PM_OK, PM_OK));
                    }
                });
            }
        });
    }
}
