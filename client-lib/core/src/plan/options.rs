//! What a client asks of the plan.

use crate::engine::{CullError, EngineChoice, ReserveError};
use crate::mask::{Encoding, EncodingChoice};
use crate::units::BoxCount;

/// What a client leaves open and what it forces, and what is known of its last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullOptions {
    /// Which engine.
    pub engine: EngineChoice,
    /// Which encoding.
    pub encoding: EncodingChoice,
    /// Most threads; `None` is as many as the calling thread's pool has. The plan takes those that are worth it.
    pub threads: Option<usize>,
    /// Threads with which the client iterates over the pairs; `None` is one.
    pub iterate_threads: Option<usize>,
    /// Pairs of the client's last frame, for the plan. The answer does not depend on it.
    pub last_pairs: Option<u64>,
    /// Whether the plan passes over dense masks, of which one would not fit the reply.
    pub no_dense: bool,
}

impl CullOptions {
    /// The options of a frame of `n` boxes whose reply holds at most `limit_words` words: where the
    /// client left the encoding open and a dense mask does not fit, it is another.
    #[must_use]
    pub fn within(self, n: usize, limit_words: u64) -> Self {
        let is_open = self.encoding == EncodingChoice::Auto;
        Self { no_dense: self.no_dense || (is_open && !dense_fits(n, limit_words)), ..self }
    }

    /// The options to try after `error` of a mask in an encoding, if there are any: where the client
    /// left the encoding open and more was found than the reply holds. A dense mask, where that fits;
    /// else a sparse one after a list, since its words hold up to 32 pairs each.
    #[must_use]
    pub fn after(
        self,
        tried: Encoding,
        error: &CullError,
        n: usize,
        limit_words: u64,
    ) -> Option<Self> {
        let is_too_large = matches!(error, CullError::Reserve(ReserveError::TooLarge { .. }));
        if !is_too_large || self.encoding != EncodingChoice::Auto {
            return None;
        }
        let only = |encoding| Self { encoding: EncodingChoice::Only(encoding), ..self };
        if dense_fits(n, limit_words) {
            return Some(only(Encoding::Dense));
        }
        (tried == Encoding::List).then(|| only(Encoding::Sparse))
    }
}

/// Whether a reply of so many words holds the dense mask of `n` boxes.
fn dense_fits(n: usize, limit_words: u64) -> bool {
    BoxCount::of_len(n).is_some_and(|n| n.dense_words() <= limit_words)
}
