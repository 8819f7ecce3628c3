//! Handles: what a program names objects by, and the table of all objects: the one state of the process that a C
//! ABI needs, since an id does not reveal where its object lies.
//!
//! An id is a generation in its high half and a slot of the table in its low half. A slot that is used again has
//! another generation, so that an id of a dropped object names nothing. A look-up holds the table's lock shared
//! for some 30 ns. It does not wait for a call that uses the same object, which is an error: [`PM_ERR_BUSY`].

use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockWriteGuard, TryLockError};

use pairmask::filters::Rules;
use pairmask::{PairMask, Pending, Session};

use crate::call::call;
use crate::code::pm_code::{self, PM_ERR_BUSY, PM_ERR_HANDLE, PM_ERR_TOO_MANY_HANDLES};
use crate::failure::Failure;
use crate::filters::pm_rules;
use crate::frame::{Frame, pm_frame};
use crate::mask::{Mask, pm_mask, pm_pending};
use crate::scene::{Scene, pm_scene};
use crate::session::pm_session;

/// A handle: an id, which is zero for none.
pub trait Handle: Copy {
    /// The type of its object, which no other kind of handle has.
    type Named: Send + 'static;

    fn of_id(id: u64) -> Self;
    fn id(self) -> u64;

    /// A handle of a new object.
    fn new(named: Self::Named) -> Result<Self, Failure> {
        TABLE.insert(named).map(Self::of_id)
    }

    /// Uses the object.
    fn with<R>(
        self,
        work: impl FnOnce(&mut Self::Named) -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        TABLE.hold(self.id(), |object| work(object.as_mut().ok_or(NOTHING)?))
    }

    /// Removes the object: the handle names nothing any more.
    fn remove(self) -> Result<Self::Named, Failure> {
        TABLE.remove(self.id())
    }

    /// Drops the object. A handle that is zero names nothing, which is fine.
    fn drop(self) -> pm_code {
        call(|| if self.id() == 0 { Ok(()) } else { self.remove().map(drop) })
    }
}

macro_rules! handles {
    ($($handle:ident names $named:ty),* $(,)?) => {
        $(impl Handle for $handle {
            type Named = $named;

            fn of_id(id: u64) -> Self {
                Self { id }
            }
            fn id(self) -> u64 {
                self.id
            }
        })*
    };
}

handles! {
    pm_session names Session,
    pm_frame names Frame,
    pm_pending names Pending<PairMask>,
    pm_mask names Mask,
    pm_rules names Arc<Rules>,
    pm_scene names Scene,
}

/// An object, until it is removed. A call locks it for as long as it uses it.
type Object<T> = Mutex<Option<T>>;

/// A slot for an object.
#[derive(Default)]
struct Slot {
    /// That of the object, from 1, or of the last one.
    generation: u32,
    /// An [`Object`] of some type.
    object: Option<Arc<dyn Any + Send + Sync>>,
}

struct Slots {
    all: Vec<Slot>,
    free: Vec<u32>,
}

struct Table(RwLock<Slots>);

static TABLE: Table = Table::new();

const NOTHING: Failure = Failure::new(
    PM_ERR_HANDLE,
    "the handle names nothing: it is zero, was dropped, or is of another kind",
);

impl Table {
    const fn new() -> Self {
        Self(RwLock::new(Slots { all: Vec::new(), free: Vec::new() }))
    }

    fn write(&self) -> RwLockWriteGuard<'_, Slots> {
        // Nothing panics with it half changed.
        self.0.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// The id of a new object.
    fn insert<T: Send + 'static>(&self, object: T) -> Result<u64, Failure> {
        let object: Arc<Object<T>> = Arc::new(Mutex::new(Some(object)));
        let slots = &mut *self.write();
        let text = "more live handles than there are ids";
        let end = u32::try_from(slots.all.len());
        let at =
            slots.free.pop().or(end.ok()).ok_or(Failure::new(PM_ERR_TOO_MANY_HANDLES, text))?;
        if at as usize == slots.all.len() {
            slots.all.push(Slot::default());
        }
        let slot = &mut slots.all[at as usize];
        slot.generation += 1;
        slot.object = Some(object);
        Ok(u64::from(slot.generation) << 32 | u64::from(at))
    }

    /// Locks the object of an id for a call.
    fn hold<T: Send + 'static, R>(
        &self,
        id: u64,
        work: impl FnOnce(&mut Option<T>) -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        let slots = self.0.read().unwrap_or_else(PoisonError::into_inner);
        let slot = slots.all.get(id as u32 as usize);
        let slot = slot.filter(|slot| u64::from(slot.generation) == id >> 32);
        let object = slot.and_then(|slot| slot.object.clone()).ok_or(NOTHING)?;
        drop(slots);
        let object = object.downcast::<Object<T>>().map_err(|_| NOTHING)?;
        match object.try_lock() {
            Ok(mut object) => work(&mut object),
            Err(TryLockError::WouldBlock) => {
                let text = "another call uses the handle: a session and what comes of it belong to one thread at a time";
                Err(Failure::new(PM_ERR_BUSY, text))
            }
            Err(TryLockError::Poisoned(_)) => {
                Err(Failure::new(PM_ERR_HANDLE, "a call with this handle has panicked"))
            }
        }
    }

    /// Removes the object of an id.
    fn remove<T: Send + 'static>(&self, id: u64) -> Result<T, Failure> {
        let object = self.hold(id, |object| object.take().ok_or(NOTHING))?;
        let slots = &mut *self.write();
        let slot = &mut slots.all[id as u32 as usize];
        slot.object = None;
        // A slot whose generations are used up is never used again.
        if slot.generation < u32::MAX {
            slots.free.push(id as u32);
        }
        Ok(object)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::pm_code::{PM_ERR_PANIC, PM_OK};

    #[test]
    fn an_id_of_a_dropped_object_or_of_another_kind_names_nothing() {
        let rules = pm_rules::new(Arc::new(Rules::default())).expect("a slot");
        assert_eq!(pm_session { id: rules.id }.drop(), PM_ERR_HANDLE, "another kind");
        assert_eq!(rules.drop(), PM_OK);
        assert_eq!(rules.drop(), PM_ERR_HANDLE, "dropped twice");
        for id in [1, u64::MAX, 1 << 32, u64::from(u32::MAX)] {
            let found = Table::new().hold(id, |_: &mut Option<Arc<Rules>>| Ok(()));
            assert!(found.is_err() && pm_session { id }.with(|_| Ok(())).is_err(), "{id:#x}");
        }
        assert_eq!(pm_rules { id: 0 }.drop(), PM_OK, "zero is null");
    }

    #[test]
    fn a_handle_in_use_is_busy_and_one_that_panicked_is_spent() {
        let rules = pm_rules::new(Arc::new(Rules::default())).expect("a slot");
        rules
            .with(|_| {
                let other = rules.with(|_| Ok(())).expect_err("in use");
                assert_eq!(other.code, PM_ERR_BUSY);
                assert_eq!(rules.drop(), PM_ERR_BUSY);
                Ok(())
            })
            .expect("free");
        let code = call(|| rules.with(|_| panic!("as a bug would")));
        assert_eq!(code, PM_ERR_PANIC);
        assert_eq!(rules.drop(), PM_ERR_HANDLE);
    }

    #[test]
    fn a_slot_is_used_again_with_another_generation_and_an_old_id_is_not_busy() {
        let table = Table::new();
        let code = |id| table.hold(id, |_: &mut Option<u8>| Ok(())).expect_err("an error").code;
        let old = table.insert(1u8).expect("a slot");
        assert_eq!(table.remove::<u8>(old).expect("there"), 1);
        let id = table.insert(2u8).expect("a slot");
        assert_eq!((id as u32, id >> 32), (old as u32, (old >> 32) + 1));
        let held = table.hold(id, |object: &mut Option<u8>| {
            assert_eq!((code(id), code(old)), (PM_ERR_BUSY, PM_ERR_HANDLE));
            Ok(*object)
        });
        assert_eq!(held.expect("free"), Some(2));
        // Its generations are used up.
        table.write().all[0].generation = u32::MAX;
        table.remove::<u8>(id | u64::from(u32::MAX) << 32).expect("there");
        assert_eq!(table.insert(3u8).expect("a slot"), 1 << 32 | 1);
    }

    #[test]
    fn many_threads_make_and_drop() {
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..1_000 {
                        let rules = pm_rules::new(Arc::new(Rules::default())).expect("a slot");
                        let other = pm_rules::new(Arc::new(Rules::default())).expect("a slot");
                        assert_ne!(rules.id, other.id);
                        assert_eq!((rules.drop(), other.drop()), (PM_OK, PM_OK));
                    }
                });
            }
        });
    }
}
