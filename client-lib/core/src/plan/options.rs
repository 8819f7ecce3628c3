//! What a client asks of the plan.

use crate::engine::{CullError, EngineChoice, ReserveError};
use crate::mask::{Encoding, EncodingChoice, ReadableEncodings};
use crate::units::BoxCount;

/// What a client leaves open and what it insists on, and what is known of its last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullOptions {
    /// Which engine.
    pub engine: EngineChoice,
    /// Which encoding.
    pub encoding: EncodingChoice,
    /// How many threads; `None` leaves it to the plan.
    pub threads: Option<usize>,
    /// Threads with which the client visits the pairs; `None` is one.
    pub visit_threads: Option<usize>,
    /// Pairs of the client's last frame, for the plan. The answer does not depend on it.
    pub last_pairs: Option<u64>,
    /// Encodings that the client can read.
    pub readable: ReadableEncodings,
}

impl CullOptions {
    /// The options of a frame of `n` boxes whose reply holds at most `limit_words` words: where the
    /// client left the encoding open and a dense mask does not fit, it is sparse.
    #[must_use]
    pub fn within(self, n: usize, limit_words: u64) -> Self {
        let may_be_sparse =
            self.encoding == EncodingChoice::Auto && self.readable.contains(Encoding::Sparse);
        if may_be_sparse && !dense_fits(n, limit_words) {
            return Self { encoding: EncodingChoice::Only(Encoding::Sparse), ..self };
        }
        self
    }

    /// The options to try after `error`, if there is one: where the client left the encoding open, more
    /// words were found than the reply holds, and a dense mask fits.
    #[must_use]
    pub fn after(self, error: &CullError, n: usize, limit_words: u64) -> Option<Self> {
        let is_too_large = matches!(error, CullError::Reserve(ReserveError::TooLarge { .. }));
        let dense = Self { encoding: EncodingChoice::Only(Encoding::Dense), ..self };
        let is_open =
            self.encoding == EncodingChoice::Auto && self.readable.contains(Encoding::Dense);
        (is_too_large && is_open && dense_fits(n, limit_words)).then_some(dense)
    }
}

/// Whether a reply of so many words holds the dense mask of `n` boxes.
fn dense_fits(n: usize, limit_words: u64) -> bool {
    BoxCount::of_len(n).is_some_and(|n| n.dense_words() <= limit_words)
}
