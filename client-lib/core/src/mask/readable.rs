//! Which encodings a client can read: a later daemon knows more of them than an earlier client.

use super::Encoding;

/// The encodings that a client can read, by the minor wire version that it speaks. The plan
/// of a frame chooses among these.
///
/// ```
/// use pairmask_core::mask::{Encoding, ReadableEncodings};
/// assert!(ReadableEncodings::at_minor(0).contains(Encoding::Sparse));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadableEncodings {
    /// Whether each of [`Encoding::ALL`] is readable.
    is_readable: [bool; Encoding::ALL.len()],
}

impl Default for ReadableEncodings {
    /// Those of this build: of a mask that stays in the process.
    fn default() -> Self {
        Self::by(|_| true)
    }
}

impl ReadableEncodings {
    /// Those of a client that speaks a minor wire version.
    pub fn at_minor(minor: u16) -> Self {
        Self::by(|encoding| encoding.since_minor() <= minor)
    }

    /// Those that a rule allows. Tests have rules of versions that are yet to come.
    pub(crate) fn by(is_readable: impl Fn(Encoding) -> bool) -> Self {
        Self { is_readable: Encoding::ALL.map(is_readable) }
    }

    /// These without one.
    #[must_use]
    pub fn without(mut self, encoding: Encoding) -> Self {
        self.is_readable[encoding.place()] = false;
        self
    }

    /// Whether the client can read an encoding.
    pub const fn contains(self, encoding: Encoding) -> bool {
        self.is_readable[encoding.place()]
    }
}
