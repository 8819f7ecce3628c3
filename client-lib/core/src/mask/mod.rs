//! Pair masks: one bit a pair, dense or sparse, or the pairs themselves.
//!
//! **Dense** (Avril et al. 2012, §3.4): bit k of the string is pair k in row order; word k/32,
//! bit k%32; tail bits are zero.
//!
//! **Sparse**: only non-zero words, each with its address. A word is (row, column block, bits):
//! bit t names the pair of positions (row, 32·block + t), always with row < column. Positions are
//! box indices, or, when the reply carries an `order`, indices into that order. Sorted by
//! (row, block).
//!
//! **List**: the pairs of box indices themselves, smaller first, in the order in which the engine
//! found them, each once.
//!
//! All encodings stand in `encodings`: what depends on them goes through it.

mod encodings;
mod error;
mod fetch_ahead;
mod pair_buffer;
mod pair_check;
mod pair_list;
mod pairs;
mod par_pairs;
mod view;
mod word_flags;
mod words;

pub use encodings::*;
pub use error::{MaskError, Section};
pub use pair_list::{PairList, PairListIter};
pub use pairs::Pairs;
pub use par_pairs::ParPairs;
pub use words::{AddressedWord, WordAddress, Words};

use std::fmt;
use std::str::FromStr;

use crate::unknown_name::UnknownName;

/// A client's options: one encoding, or whichever the plan finds cheaper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EncodingChoice {
    /// The plan chooses.
    #[default]
    Auto,
    /// This encoding and no other.
    Only(Encoding),
}

impl FromStr for EncodingChoice {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        if s == "auto" {
            return Ok(Self::Auto);
        }
        let named = Encoding::ALL.into_iter().find(|encoding| encoding.as_str() == s);
        named.map(Self::Only).ok_or_else(|| UnknownName {
            name: s.to_owned(),
            known: format!("auto, {}", Encoding::ALL.map(Encoding::as_str).join(", ")).into(),
        })
    }
}

impl fmt::Display for EncodingChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Only(e) => e.fmt(f),
        }
    }
}

/// A run of u32 words within a reply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// First word, counted from the start of the reply.
    pub start: u64,
    /// Number of words.
    pub len: u64,
}

impl Span {
    /// The words of the span, or `None` where the reply is shorter.
    pub fn of<'a>(&self, reply: &'a [u32]) -> Option<&'a [u32]> {
        let start = usize::try_from(self.start).ok()?;
        reply.get(start..start.checked_add(usize::try_from(self.len).ok()?)?)
    }
}

/// Sections start on multiples of 16 words (64 bytes: a cache line, an AVX-512 register).
pub const SECTION_ALIGN_WORDS: u64 = 16;
