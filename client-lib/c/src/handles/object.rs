//! What a handle may name.

use std::sync::Arc;

use pairmask::filters::Rules;

use crate::frame::Frame;
use crate::mask::{Mask, Pending};
use crate::query::Found;
use crate::scene::Scene;
use crate::session::Session;

/// A kind of object.
pub trait Kind: Sized {
    /// The object as the table keeps it.
    fn wrap(self) -> Object;
    /// The object, if it is of this kind.
    fn of(object: &mut Object) -> Option<&mut Self>;
    /// The object, if it is of this kind, else as it was.
    #[allow(clippy::result_large_err)] // It is put back.
    fn take(object: Object) -> Result<Self, Object>;
}

/// Makes the kinds.
macro_rules! objects {
    ($($(#[$doc:meta])* $kind:ident($object:ty)),* $(,)?) => {
        /// An object that a handle names.
        pub enum Object {
            $($(#[$doc])* $kind($object)),*
        }

        $(impl Kind for $object {
            fn wrap(self) -> Object {
                Object::$kind(self)
            }
            fn of(object: &mut Object) -> Option<&mut Self> {
                match object {
                    Object::$kind(object) => Some(object),
                    _ => None,
                }
            }
            fn take(object: Object) -> Result<Self, Object> {
                match object {
                    Object::$kind(object) => Ok(object),
                    other => Err(other),
                }
            }
        })*
    };
}

objects! {
    /// `pm_session`.
    Session(Session),
    /// `pm_frame`.
    Frame(Frame),
    /// `pm_pending`.
    Pending(Pending),
    /// `pm_mask`.
    Mask(Mask),
    /// `pm_rules`.
    Rules(Arc<Rules>),
    /// `pm_scene`.
    Scene(Box<Scene>),
    /// `pm_found`.
    Found(Found),
}
