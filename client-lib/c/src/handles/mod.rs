//! Handles: what a client names objects by.

mod object;
mod table;

pub(crate) use self::table::{insert, remove, with};

/// Makes the handles of the header.
macro_rules! handle {
    ($name:ident is $object:ty) => {
        impl $name {
            /// A handle of a new object.
            pub(crate) fn new(object: $object) -> Result<Self, crate::failure::Failure> {
                Ok(Self { id: crate::handles::insert(object)? })
            }

            /// Uses the object.
            pub(crate) fn with<R>(
                self,
                work: impl FnOnce(&mut $object) -> Result<R, crate::failure::Failure>,
            ) -> Result<R, crate::failure::Failure> {
                crate::handles::with(self.id, work)
            }

            /// Takes the object out: the handle names nothing any more.
            pub(crate) fn remove(self) -> Result<$object, crate::failure::Failure> {
                crate::handles::remove(self.id)
            }

            /// Drops the object. A handle that is zero names nothing, which is fine.
            pub(crate) fn drop(self) -> crate::code::pm_code {
                crate::call::call(|| if self.id == 0 { Ok(()) } else { self.remove().map(drop) })
            }
        }
    };
}
pub(crate) use handle;
