//! What can be wrong with a mask that came from another process.

use std::fmt;

use super::Span;

/// A section of a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    /// The words of a dense mask.
    Words,
    /// Rows of a sparse mask.
    Rows,
    /// Column blocks of a sparse mask.
    Blocks,
    /// Bits of a sparse mask.
    Bits,
    /// Box indices by position.
    Order,
    /// The pairs of a list.
    Pairs,
}

impl fmt::Display for Section {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Words => "words",
            Self::Rows => "rows",
            Self::Blocks => "blocks",
            Self::Bits => "bits",
            Self::Order => "order",
            Self::Pairs => "pairs",
        })
    }
}

/// Why a reply is no mask of so many boxes. Numbers of words and pairs count from the start of their
/// section.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MaskError {
    /// A section ends behind the reply.
    #[error(
        "section '{section}' spans {} words from word {}, but the reply holds {reply_words}: the reply's header is damaged, drop the reply",
        span.len, span.start
    )]
    OutsideReply {
        /// Which section.
        section: Section,
        /// Where the header says it lies.
        span: Span,
        /// Words of the reply.
        reply_words: u64,
    },
    /// A dense mask has as many words as its boxes have pairs, over 32.
    #[error(
        "a dense mask of {n} boxes has {expected} words, this one {found}: the reply belongs to another scene or is damaged"
    )]
    DenseLength {
        /// Boxes of the scene.
        n: u32,
        /// Words that `n` boxes need.
        expected: u64,
        /// Words of the section.
        found: u64,
    },
    /// Rows, blocks and bits describe the same words and have the same length.
    #[error("a sparse mask has {rows} rows, {blocks} blocks and {bits} bits: they must be equal")]
    SectionLengths {
        /// Words of the rows.
        rows: u64,
        /// Words of the blocks.
        blocks: u64,
        /// Words of the bits.
        bits: u64,
    },
    /// An order names every box once.
    #[error("the order of {n} boxes has {found} positions: they must be equal")]
    OrderLength {
        /// Boxes of the scene.
        n: u32,
        /// Positions of the order.
        found: u64,
    },
    /// Bits behind the last pair of a dense mask.
    #[error("the last word of the dense mask has bits {bits:#010x} behind the last pair")]
    TailBits {
        /// The bits that should be zero.
        bits: u32,
    },
    /// A sparse mask holds only words with a pair.
    #[error("sparse word {word} is zero")]
    ZeroWord {
        /// Number of the word.
        word: u64,
    },
    /// Words are sorted by (row, block), each address once.
    #[error("sparse word {word} does not come after the word before it by (row, block)")]
    NotSorted {
        /// Number of the later word.
        word: u64,
    },
    /// A column block starts behind the last box.
    #[error("sparse word {word} names column block {block}, of {blocks}")]
    NoSuchBlock {
        /// Number of the word.
        word: u64,
        /// The block that it names.
        block: u32,
        /// Blocks of a row.
        blocks: u32,
    },
    /// Bits whose column is not after the row or is behind the last box.
    #[error("sparse word {word} has bits {bits:#010x} that name no pair of row {row}")]
    NoSuchPair {
        /// Number of the word.
        word: u64,
        /// Its row.
        row: u32,
        /// The bits that should be zero.
        bits: u32,
    },
    /// The order names a box that is not there.
    #[error("position {position} of the order names box {index}, of {n}")]
    NoSuchBox {
        /// Position in the order.
        position: u32,
        /// The box that it names.
        index: u32,
        /// Boxes of the scene.
        n: u32,
    },
    /// The order names a box a second time.
    #[error("position {position} of the order names box {index} again")]
    BoxAgain {
        /// The later position.
        position: u32,
        /// The box.
        index: u32,
    },
    /// A pair of a list is two words.
    #[error("a list of {words} words ends with half a pair")]
    HalfPair {
        /// Words of the section.
        words: u64,
    },
    /// A list holds only pairs of boxes, smaller index first.
    #[error("pair {number} of the list is ({a}, {b}): no pair of {n} boxes, smaller first")]
    NotAPair {
        /// Number of the pair.
        number: u64,
        /// Its first index.
        a: u32,
        /// Its second index.
        b: u32,
        /// Boxes of the scene.
        n: u32,
    },
    /// A list names a pair once.
    #[error("the list names the pair ({a}, {b}) more than once")]
    PairAgain {
        /// The smaller index.
        a: u32,
        /// The larger index.
        b: u32,
    },
}
