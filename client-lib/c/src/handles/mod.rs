//! Handles: what a program names objects by.

mod table;

use std::sync::Arc;

use pairmask::filters::Rules;

use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::frame::{Frame, pm_frame};
use crate::mask::{Mask, Pending, pm_mask, pm_pending};
use crate::rules::pm_rules;
use crate::scene::{Scene, pm_scene};
use crate::session::{Session, pm_session};

/// A handle: an id, which is zero for none.
pub trait Handle: Copy {
    /// What it names.
    type Named;

    fn of_id(id: u64) -> Self;
    fn id(self) -> u64;
    /// The object as the table keeps it.
    fn wrap(named: Self::Named) -> Object;
    /// The object, if it is of this kind.
    fn of(object: &mut Object) -> Option<&mut Self::Named>;
    /// The same, taken out.
    fn take(object: Object) -> Option<Self::Named>;

    /// A handle of a new object.
    fn new(named: Self::Named) -> Result<Self, Failure> {
        table::insert(Self::wrap(named)).map(Self::of_id)
    }

    /// Uses the object.
    fn with<R>(
        self,
        work: impl FnOnce(&mut Self::Named) -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        table::with(self, work)
    }

    /// Takes the object out: the handle names nothing any more.
    fn remove(self) -> Result<Self::Named, Failure> {
        table::remove(self)
    }

    /// Drops the object. A handle that is zero names nothing, which is fine.
    fn drop(self) -> pm_code {
        call(|| if self.id() == 0 { Ok(()) } else { self.remove().map(drop) })
    }
}

/// Makes the kinds of objects.
macro_rules! objects {
    ($($kind:ident: $handle:ident names $named:ty),* $(,)?) => {
        /// An object that a handle names.
        pub enum Object {
            $($kind($named)),*
        }

        $(impl Handle for $handle {
            type Named = $named;

            fn of_id(id: u64) -> Self {
                Self { id }
            }
            fn id(self) -> u64 {
                self.id
            }
            fn wrap(named: $named) -> Object {
                Object::$kind(named)
            }
            fn of(object: &mut Object) -> Option<&mut $named> {
                match object {
                    Object::$kind(named) => Some(named),
                    _ => None,
                }
            }
            fn take(object: Object) -> Option<$named> {
                match object {
                    Object::$kind(named) => Some(named),
                    _ => None,
                }
            }
        })*
    };
}

objects! {
    Session: pm_session names Session,
    Frame: pm_frame names Frame,
    Pending: pm_pending names Pending,
    Mask: pm_mask names Mask,
    Rules: pm_rules names Arc<Rules>,
    Scene: pm_scene names Box<Scene>,
}
