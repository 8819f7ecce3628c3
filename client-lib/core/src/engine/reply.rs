//! Where masks are written: memory of the session or daemon that publishes them.

use std::sync::Arc;

use crate::cancel::Wanted;

/// Memory for a mask, lent by the session or daemon that publishes it.
pub trait ReplyBuffer {
    /// The most words that [`Self::reserve`] ever lends; `u64::MAX` where memory is the only limit.
    /// It is known before a frame and stays the same throughout it: engines stop looking for pairs
    /// when what they found cannot be lent any more.
    fn limit_words(&self) -> u64;

    /// At least `words` u32 words, aligned to 64 bytes, contents unspecified. A second call
    /// replaces the first; nothing of the first is kept.
    ///
    /// # Errors
    /// [`ReserveError`] when so much memory is not available.
    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError>;

    /// Says whether somebody still waits for the mask; `None` where it is wanted in any case. Engines ask for it once a
    /// frame, and end with [`CullError::Cancelled`](super::CullError::Cancelled) soon after nobody does.
    fn asker(&self) -> Option<Arc<dyn Wanted>> {
        None
    }
}

/// The mask does not fit into the memory that may be used for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReserveError {
    /// Larger than the largest reply of this instance.
    #[error(
        "the mask needs {at_least_bytes} bytes or more and a reply holds at most {limit_bytes}: leave the encoding open, or serve with a larger --max-reply-mib"
    )]
    TooLarge {
        /// Bytes that the mask needs at the least. A search ends when it has found more than a reply
        /// holds, so that the rest is not known.
        at_least_bytes: u64,
        /// Bytes of the largest reply.
        limit_bytes: u64,
    },
    /// The system has no memory left; in a daemon, /dev/shm is full.
    #[error(
        "no memory for a mask of {needed_bytes} bytes: leave the encoding open, or free memory"
    )]
    OutOfMemory {
        /// Bytes of the mask.
        needed_bytes: u64,
    },
}
