//! Pair masks: one bit a pair, dense or sparse.
//!
//! **Dense** (Avril et al. 2012, §3.4): bit k of the string is pair k in row order; word k/32,
//! bit k%32; tail bits are zero.
//!
//! **Sparse**: only non-zero words, each with its address. A word is (row, column block, bits):
//! bit t names the pair of positions (row, 32·block + t), always with row < column. Positions are
//! box indices, or, when the reply carries an `order`, indices into that order. Sorted by
//! (row, block).

mod dense;
mod dense_pairs;
mod dense_words;
mod error;
mod pair_buffer;
mod pairs;
mod par_pairs;
mod readable;
mod sparse;
mod sparse_pairs;
mod sparse_words;
mod view;
mod word_flags;
mod words;

pub use dense::DenseMask;
pub use error::{MaskError, Section};
pub use pairs::Pairs;
pub use par_pairs::ParPairs;
pub use readable::ReadableEncodings;
pub use sparse::SparseMask;
pub use view::MaskView;
pub use words::{AddressedWord, WordAddress, Words};

use std::fmt;
use std::str::FromStr;

use crate::units::BoxCount;
use crate::unknown_name::UnknownName;

/// How a mask is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Encoding {
    /// One bit for every pair.
    Dense = 1,
    /// Non-zero 32-bit words with their addresses.
    Sparse = 2,
}

impl Encoding {
    /// Every encoding, in the order of their numbers.
    pub const ALL: [Self; 2] = [Self::Dense, Self::Sparse];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Sparse => "sparse",
        }
    }

    /// The minor wire version from which clients can read the encoding.
    pub const fn since_minor(self) -> u16 {
        match self {
            Self::Dense | Self::Sparse => 0,
        }
    }

    /// Its place in [`Self::ALL`].
    pub const fn place(self) -> usize {
        match self {
            Self::Dense => 0,
            Self::Sparse => 1,
        }
    }

    /// The encoding of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|e| *e as u32 == value)
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A client's wish: one encoding, or whichever the plan finds cheaper.
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

/// Where the sections of a mask lie in a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskShape {
    /// The words of a dense mask.
    Dense {
        /// All words.
        words: Span,
    },
    /// The three arrays of a sparse mask and, unless the order is the identity, the order.
    Sparse {
        /// Row of each word.
        rows: Span,
        /// Column block of each word.
        blocks: Span,
        /// Bits of each word.
        bits: Span,
        /// Box index at each position.
        order: Option<Span>,
    },
}

impl MaskShape {
    /// The dense mask of `n` boxes, at the start of the reply.
    pub const fn dense(n: BoxCount) -> Self {
        Self::Dense { words: Span { start: 0, len: n.dense_words() } }
    }

    /// A sparse mask with room for `capacity` words of which `word_count` are used, at the start
    /// of the reply: `rows`, `blocks`, `bits`, then `order` of `n` positions if there is one.
    ///
    /// An engine that knows its size beforehand passes it twice.
    pub const fn sparse(n: BoxCount, capacity: u64, word_count: u64, with_order: bool) -> Self {
        let stride = capacity.next_multiple_of(SECTION_ALIGN_WORDS);
        Self::Sparse {
            rows: Span { start: 0, len: word_count },
            blocks: Span { start: stride, len: word_count },
            bits: Span { start: 2 * stride, len: word_count },
            order: if with_order {
                Some(Span { start: 3 * stride, len: n.get() as u64 })
            } else {
                None
            },
        }
    }

    /// The most words with which the [`Self::sparse`] mask of `n` boxes that knows its size takes
    /// `limit_words` words of a reply or less. `None` where not even the mask without words does.
    ///
    /// ```
    /// use pairmask::{BoxCount, mask::MaskShape};
    ///
    /// let n = BoxCount::new(100);
    /// assert_eq!(MaskShape::sparse_words_within(n, 148, true), Some(16));
    /// assert_eq!(MaskShape::sparse(n, 16, 16, true).extent_words(), 148);
    /// assert_eq!(MaskShape::sparse_words_within(n, 99, true), None, "the order has 100 words");
    /// ```
    pub fn sparse_words_within(n: BoxCount, limit_words: u64, with_order: bool) -> Option<u64> {
        let align = SECTION_ALIGN_WORDS;
        if with_order {
            // The order stands behind three whole strides.
            let arrays = limit_words.checked_sub(u64::from(n.get()))?;
            return Some(arrays / 3 / align * align);
        }
        // Only the first two arrays take whole strides.
        let whole = limit_words / 3 / align * align;
        let after_two_more = limit_words.saturating_sub(2 * (whole + align));
        Some(if after_two_more > whole { after_two_more.min(whole + align) } else { whole })
    }

    /// The mask of `n` boxes and `word_count` words, with an order or not, in an encoding, at the
    /// start of the reply.
    pub const fn exact(encoding: Encoding, n: BoxCount, word_count: u64, with_order: bool) -> Self {
        match encoding {
            Encoding::Dense => Self::dense(n),
            Encoding::Sparse => Self::sparse(n, word_count, word_count, with_order),
        }
    }

    /// The most words of an engine that a reply of `limit_words` words holds in an encoding. `None`
    /// where it does not even hold the mask without any.
    ///
    /// The words of a dense mask are not counted: its size follows from `n`.
    pub fn words_within(
        encoding: Encoding,
        n: BoxCount,
        limit_words: u64,
        with_order: bool,
    ) -> Option<u64> {
        match encoding {
            Encoding::Dense => (n.dense_words() <= limit_words).then_some(u64::MAX),
            Encoding::Sparse => Self::sparse_words_within(n, limit_words, with_order),
        }
    }

    /// The encoding of this shape.
    pub const fn encoding(&self) -> Encoding {
        match self {
            Self::Dense { .. } => Encoding::Dense,
            Self::Sparse { .. } => Encoding::Sparse,
        }
    }

    /// Words of the mask of `n` boxes that are zero and were therefore not written, of an encoding
    /// that leaves them out.
    pub const fn zero_words(&self, n: BoxCount) -> u64 {
        match self {
            Self::Dense { .. } => 0,
            Self::Sparse { bits, .. } => n.sparse_words_max().saturating_sub(bits.len),
        }
    }

    /// Words of the reply from its start to the end of the last section. Saturates, since a shape
    /// may come from another process.
    pub fn extent_words(&self) -> u64 {
        let end = |s: &Span| s.start.saturating_add(s.len);
        match self {
            Self::Dense { words } => end(words),
            Self::Sparse { rows, blocks, bits, order } => {
                [end(rows), end(blocks), end(bits), order.as_ref().map_or(0, end)]
                    .into_iter()
                    .max()
                    .unwrap_or(0)
            }
        }
    }

    /// Bytes of the mask itself, without gaps between sections. Saturates likewise.
    pub fn mask_bytes(&self) -> u64 {
        let words = match self {
            Self::Dense { words } => words.len,
            Self::Sparse { rows, blocks, bits, order } => [rows, blocks, bits]
                .into_iter()
                .chain(order)
                .fold(0, |sum: u64, span| sum.saturating_add(span.len)),
        };
        words.saturating_mul(4)
    }
}
