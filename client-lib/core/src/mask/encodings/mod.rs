//! All encodings: their names, the shapes of their masks, and their decoders. What depends on the
//! encoding of a mask is decided here; each decoder has files of its own.

mod dense;
mod dense_pairs;
mod dense_words;
mod list;
mod sparse;
mod sparse_pairs;
mod sparse_words;

pub use self::dense::DenseMask;
pub use self::list::ListMask;
pub use self::sparse::SparseMask;

use std::fmt;
use std::ops::Range;

use self::dense_pairs::DensePairs;
use self::dense_words::DenseWords;
use self::list::ListPairs;
use self::sparse_pairs::SparsePairs;
use self::sparse_words::SparseWords;
use super::pair_buffer::PairBuffer;
use super::word_flags::CHUNK_WORDS;
use super::{AddressedWord, MaskError, Pairs, SECTION_ALIGN_WORDS, Span, WordAddress, Words};
use crate::isa::AvailableIsa;
use crate::units::{BoxCount, MaskWord, PairIndex};

/// How a mask is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
#[non_exhaustive]
pub enum Encoding {
    /// One bit for every pair.
    Dense = 1,
    /// Non-zero 32-bit words with their addresses.
    Sparse = 2,
    /// Pairs of box indices.
    List = 3,
}

impl Encoding {
    /// Every encoding, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Dense, Self::Sparse, Self::List];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Sparse => "sparse",
            Self::List => "list",
        }
    }

    /// Its place in [`Self::ALL`].
    pub const fn ordinal(self) -> usize {
        self as usize - 1
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

/// Where the sections of a mask lie in a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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
    /// The pairs of a list, smaller index first, two words each.
    List {
        /// All pairs.
        pairs: Span,
    },
}

impl MaskShape {
    /// The dense mask of `n` boxes, at the start of the reply.
    pub const fn dense(n: BoxCount) -> Self {
        Self::Dense { words: Span { start: 0, len: n.dense_words() } }
    }

    /// A list of so many pairs, at the start of the reply.
    pub const fn list(pair_count: u64) -> Self {
        Self::List { pairs: Span { start: 0, len: pair_count.saturating_mul(2) } }
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

    /// The mask of `n` boxes and `word_count` words (pairs of a list), with an order or not, in an
    /// encoding, at the start of the reply.
    pub const fn exact(encoding: Encoding, n: BoxCount, word_count: u64, with_order: bool) -> Self {
        match encoding {
            Encoding::Dense => Self::dense(n),
            Encoding::Sparse => Self::sparse(n, word_count, word_count, with_order),
            Encoding::List => Self::list(word_count),
        }
    }

    /// The most words of an engine, or pairs for a list, that a reply of `limit_words` words holds in
    /// an encoding. `None` where it does not even hold the mask without any.
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
            Encoding::List => Some(limit_words / 2),
        }
    }

    /// The encoding of this shape.
    pub const fn encoding(&self) -> Encoding {
        match self {
            Self::Dense { .. } => Encoding::Dense,
            Self::Sparse { .. } => Encoding::Sparse,
            Self::List { .. } => Encoding::List,
        }
    }

    /// Words of the mask of `n` boxes that are zero and were therefore not written, of an encoding
    /// that leaves them out.
    pub const fn zero_words(&self, n: BoxCount) -> u64 {
        match self {
            Self::Dense { .. } | Self::List { .. } => 0,
            Self::Sparse { bits, .. } => n.sparse_words_max().saturating_sub(bits.len),
        }
    }

    /// All sections, in the order in which replies hold them.
    pub fn spans(&self) -> impl Iterator<Item = Span> + use<> {
        let spans = match *self {
            Self::Dense { words } => [Some(words), None, None, None],
            Self::Sparse { rows, blocks, bits, order } => {
                [Some(rows), Some(blocks), Some(bits), order]
            }
            Self::List { pairs } => [Some(pairs), None, None, None],
        };
        spans.into_iter().flatten()
    }

    /// Words of the reply from its start to the end of the last section. Saturates, since a shape
    /// may come from another process.
    pub fn extent_words(&self) -> u64 {
        self.spans().map(|span| span.start.saturating_add(span.len)).max().unwrap_or(0)
    }

    /// Bytes of the mask itself, without gaps between sections. Saturates likewise.
    pub fn mask_bytes(&self) -> u64 {
        self.spans().fold(0, |sum: u64, span| sum.saturating_add(span.len)).saturating_mul(4)
    }
}

/// What each encoding's mask, by that name, is asked for.
macro_rules! of_each {
    ($view:expr, $mask:ident => $of:expr) => {
        match $view {
            MaskView::Dense($mask) => $of,
            MaskView::Sparse($mask) => $of,
            MaskView::List($mask) => $of,
        }
    };
}

/// A pair mask in a reply, of any encoding: nothing is copied.
///
/// The reply is data from another process. [`MaskView::new`] checks in O(1) that the sections lie
/// in the reply and have the right lengths. Regardless of the bytes, decoding then never panics, ends,
/// and gives only pairs with a < b < n: bits that name no pair of boxes are dropped.
/// [`MaskView::verify`] says whether there are any. Words are read where they lie and when they are
/// needed, so the publisher of the reply must not change it while a view lives.
///
/// ```
/// use pairmask_core::BoxCount;
/// use pairmask_core::mask::{MaskShape, MaskView};
/// // Boxes 0 to 3. Bit k is pair k of (0,1) (0,2) (0,3) (1,2) (1,3) (2,3).
/// let n = BoxCount::new(4);
/// let reply = [0b10_0001];
/// let mask = MaskView::new(n, &MaskShape::dense(n), &reply)?;
/// assert_eq!(mask.to_vec(), [[0, 1], [2, 3]]);
/// assert!(mask.contains(3, 2));
///
/// // The same pairs as two words (row, block, bits), with room for 16.
/// let mut reply = [0; 48];
/// (reply[0], reply[16], reply[32]) = (0, 0, 0b0010);
/// (reply[1], reply[17], reply[33]) = (2, 0, 0b1000);
/// let mask = MaskView::new(n, &MaskShape::sparse(n, 2, 2, false), &reply)?;
/// assert_eq!(mask.to_vec(), [[0, 1], [2, 3]]);
/// mask.verify()?;
/// # Ok::<(), pairmask_core::mask::MaskError>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum MaskView<'a> {
    /// One bit for every pair.
    Dense(DenseMask<'a>),
    /// Non-zero words with their addresses.
    Sparse(SparseMask<'a>),
    /// Pairs of box indices.
    List(ListMask<'a>),
}

impl<'a> MaskView<'a> {
    /// The mask of `n` boxes that lies in `reply` as `shape` says.
    ///
    /// # Errors
    /// [`MaskError`] where a section leaves the reply or a length is wrong.
    pub fn new(n: BoxCount, shape: &MaskShape, reply: &'a [u32]) -> Result<Self, MaskError> {
        match shape {
            MaskShape::Dense { words } => DenseMask::new(n, words, reply).map(Self::Dense),
            MaskShape::Sparse { rows, blocks, bits, order } => {
                SparseMask::new(n, [rows, blocks, bits], order.as_ref(), reply).map(Self::Sparse)
            }
            MaskShape::List { pairs } => ListMask::new(n, pairs, reply).map(Self::List),
        }
    }

    /// The same mask, decoded with one instruction set in place of the widest. The pairs and their
    /// order do not depend on it.
    #[must_use]
    pub fn with_isa(self, isa: AvailableIsa) -> Self {
        match self {
            Self::Dense(mask) => Self::Dense(mask.with_isa(isa)),
            Self::Sparse(mask) => Self::Sparse(mask.with_isa(isa)),
            Self::List(mask) => Self::List(mask.with_isa(isa)),
        }
    }

    /// Number of boxes.
    #[inline]
    pub const fn n(&self) -> BoxCount {
        of_each!(self, mask => mask.n())
    }

    /// How the mask is written.
    #[inline]
    pub const fn encoding(&self) -> Encoding {
        match self {
            Self::Dense(_) => Encoding::Dense,
            Self::Sparse(_) => Encoding::Sparse,
            Self::List(_) => Encoding::List,
        }
    }

    /// Number of pairs: a pass over the words.
    ///
    /// Never less than the iterators give. It is more only where an order is malformed, since the
    /// order is not read here.
    #[must_use]
    pub fn count(&self) -> u64 {
        of_each!(self, mask => mask.count())
    }

    /// Whether boxes `a` and `b`, in any order, are a pair of the mask. False for equal and for
    /// unknown boxes.
    ///
    /// Dense: one AND. Sparse: a binary search, behind an O(n) search if there is an order. List: a
    /// pass over the list.
    #[inline]
    #[must_use]
    pub fn contains(&self, a: u32, b: u32) -> bool {
        of_each!(self, mask => mask.contains(a, b))
    }

    /// The non-zero words with their addresses, without bits that name no pair. Each pair of a list is
    /// a word of its own, in the order of the list.
    #[inline]
    #[must_use]
    pub fn words(&self) -> Words<'a> {
        match self {
            Self::Dense(mask) => Words::of(WordSource::Dense(mask.words_in(0..self.word_count()))),
            Self::Sparse(mask) => {
                let words = mask.words_in(0..self.word_count());
                Words::of(WordSource::Sparse(mask.n(), words))
            }
            Self::List(mask) => Words::of(WordSource::List(mask.pairs_in(0..mask.len()))),
        }
    }

    /// Checks every rule of the encoding, in O(words) and, with an order, O(n). Of a list, in a copy of
    /// it and as much memory again.
    ///
    /// Not needed for safety. A mask that passes holds what its bits say, no more and no less.
    ///
    /// # Errors
    /// The first rule broken, and where: [`MaskError`].
    pub fn verify(&self) -> Result<(), MaskError> {
        of_each!(self, mask => mask.verify())
    }

    /// Words of the mask as it lies in the reply, or pairs of a list.
    pub(super) fn word_count(&self) -> usize {
        match self {
            Self::Dense(mask) => mask.as_words().len(),
            Self::Sparse(mask) => mask.word_count(),
            Self::List(mask) => mask.len(),
        }
    }

    pub(super) fn pairs_in(&self, range: Range<usize>) -> Pairs<'a> {
        match self {
            Self::Dense(mask) => Pairs::of(PairSource::Dense(mask.pairs_in(range))),
            Self::Sparse(mask) => Pairs::of(PairSource::Sparse(mask.pairs_in(range))),
            Self::List(mask) => Pairs::of(PairSource::List(mask.pairs_in(range))),
        }
    }

    /// Words, or pairs of a list, of the smallest range that is worth a thread.
    pub(super) const fn grain_words(&self) -> usize {
        match self {
            Self::Dense(_) => DENSE_GRAIN_WORDS,
            Self::Sparse(_) => SPARSE_GRAIN_WORDS,
            Self::List(_) => LIST_GRAIN_PAIRS,
        }
    }
}

/// Smallest range of a dense mask worth a thread, words: 512 KiB, which one thread scans in 10 to
/// 20 µs. Waking another thread takes as long, so smaller ranges would cost time.
const DENSE_GRAIN_WORDS: usize = 2048 * CHUNK_WORDS;

/// Smallest range of a sparse mask worth a thread, words: at about 1 ns a word some 15 µs, as above.
const SPARSE_GRAIN_WORDS: usize = 1 << 14;

/// Smallest range of a list worth a thread, pairs: 256 KiB, some 15 µs as above.
const LIST_GRAIN_PAIRS: usize = 1 << 15;

/// Where the pairs of a mask come from.
#[derive(Clone)]
pub(super) enum PairSource<'a> {
    Dense(DensePairs<'a>),
    Sparse(SparsePairs<'a>),
    List(ListPairs<'a>),
}

impl PairSource<'_> {
    /// Decodes the next pairs into a buffer. False at the end of the mask.
    #[inline(always)]
    pub fn refill(&mut self, buffer: &mut PairBuffer) -> bool {
        let mut more = false;
        match self {
            Self::Dense(pairs) => buffer.refill(|writer| more = pairs.write(writer)),
            Self::Sparse(pairs) => buffer.refill(|writer| more = pairs.write(writer)),
            Self::List(pairs) => buffer.refill(|writer| more = pairs.write(writer)),
        }
        more
    }
}

/// Where the words of a mask come from.
#[derive(Clone)]
pub(super) enum WordSource<'a> {
    Dense(DenseWords<'a>),
    Sparse(BoxCount, SparseWords<'a>),
    List(ListPairs<'a>),
}

impl WordSource<'_> {
    #[inline]
    pub fn next(&mut self) -> Option<AddressedWord> {
        match self {
            Self::Dense(words) => words.next().map(|(number, bits)| AddressedWord {
                address: WordAddress::Dense { first: PairIndex::new(32 * number as u64) },
                bits: MaskWord(bits),
            }),
            Self::Sparse(n, words) => {
                let word = words.map(|word| word.without_strays(*n)).find(|word| word.bits != 0)?;
                Some(AddressedWord {
                    address: WordAddress::Sparse { row: word.row, block: word.block },
                    bits: MaskWord(word.bits),
                })
            }
            Self::List(pairs) => pairs.next_word(),
        }
    }
}
