//! The error of everything that is chosen by name.

use std::borrow::Cow;

/// A name that is none of the known ones.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown name '{name}': choose one of {known}")]
pub struct UnknownName {
    /// What was given.
    pub name: String,
    /// What may be given.
    pub known: Cow<'static, str>,
}
