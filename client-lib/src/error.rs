//! Errors that are seldom named: those of single calls, and what stands inside those of sessions.

pub use pairmask_core::engine::{CullError, UnknownName};
pub use pairmask_core::mask::MaskError;
pub use pairmask_core::precision::{BoundsError, MarginError};
pub use pairmask_core::update::UpdateError;
pub use pairmask_wire::{
    InstanceError, ReplyError, StatusCode, TooManyPairs, Version as WireVersion,
};

pub use crate::transport::LimitError;
