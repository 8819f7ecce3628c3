//! A mask in one of the forms.

use super::copy::MaskCopy;
use super::form::Form;
use super::list::PairList;
use super::packed::PackedWords;
use super::prefix::PrefixWords;
use super::sink::PairSink;
use super::words64::LongWords;

/// A mask in one of the forms. The order is not part of it: every form of positions has the same.
///
/// ```
/// use pairmask::mask::MaskShape;
/// use pairmask::{BoxCount, MaskView};
/// use pairmaskd::study::replies::{Encoded, Form, MaskCopy};
/// // Four boxes; row 1 with bits 2 and 3.
/// let mut reply = [0; 33];
/// (reply[0], reply[16], reply[32]) = (1, 0, 0b1100);
/// let n = BoxCount::new(4);
/// let view = MaskView::new(n, &MaskShape::sparse(n, 1, 1, false), &reply)?;
/// let mask = MaskCopy::of(&view)?;
/// let packed = Encoded::new(Form::Packed, &mask);
/// // One word, and one start for all rows.
/// assert_eq!(packed.bytes(), 8 + 4);
/// let mut pairs = Vec::new();
/// packed.decode(|a, b| pairs.push((a, b)));
/// assert_eq!(pairs, [(1, 2), (1, 3)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Encoded<'m> {
    mask: &'m MaskCopy,
    pub(super) words: Words,
}

/// The words, by form.
#[derive(Clone, Debug)]
pub(super) enum Words {
    /// Those of the mask.
    Sparse,
    Prefix(PrefixWords),
    Long(LongWords),
    Packed(PackedWords),
    List(PairList),
}

impl<'m> Encoded<'m> {
    /// Writes a mask in a form. A mask that does not fit the form stays as it is.
    pub fn new(form: Form, mask: &'m MaskCopy) -> Self {
        let words = match form {
            Form::Sparse => None,
            Form::Prefix => PrefixWords::of(mask).map(Words::Prefix),
            Form::Words64 => Some(Words::Long(LongWords::of(mask))),
            Form::Packed => PackedWords::of(mask).map(Words::Packed),
            Form::List => {
                let mut pairs = Vec::new();
                Self { mask, words: Words::Sparse }.decode(|a, b| pairs.push([a, b]));
                Some(Words::List(PairList { pairs }))
            }
        };
        Self { mask, words: words.unwrap_or(Words::Sparse) }
    }

    /// Bytes, without the order.
    pub fn bytes(&self) -> u64 {
        match &self.words {
            Words::Sparse => self.mask.word_bytes(),
            Words::Prefix(words) => words.bytes(),
            Words::Long(words) => words.bytes(),
            Words::Packed(words) => words.bytes(),
            Words::List(list) => list.bytes(),
        }
    }

    /// Bytes of the order that a client needs beside it, whether sent or kept.
    pub fn order_bytes(&self) -> u64 {
        match self.words {
            Words::List(_) => 0,
            _ => 4 * self.mask.order().map_or(0, |order| order.len() as u64),
        }
    }

    /// Words, or pairs of a list.
    pub fn entry_count(&self) -> u64 {
        match &self.words {
            Words::Sparse | Words::Prefix(_) | Words::Packed(_) => self.mask.word_count(),
            Words::Long(words) => words.bits.len() as u64,
            Words::List(list) => list.pairs.len() as u64,
        }
    }

    /// Calls `take(a, b)` for each pair, a < b, in the order of the words.
    pub fn decode(&self, take: impl FnMut(u32, u32)) {
        let n = self.mask.n().get();
        let sink = |take| PairSink::new(n, self.mask.order(), take);
        match &self.words {
            Words::Sparse => through(sink(take), |sink| self.mask.walk(sink)),
            Words::Prefix(words) => through(sink(take), |sink| words.walk(sink)),
            Words::Long(words) => through(sink(take), |sink| words.walk(sink)),
            Words::Packed(words) => through(sink(take), |sink| words.walk(sink)),
            Words::List(list) => list.walk(n, take),
        }
    }
}

/// Puts all words into a sink, and takes what is left in it.
#[inline(always)]
fn through<'o, F: FnMut(u32, u32)>(
    mut sink: PairSink<'o, F>,
    walk: impl FnOnce(&mut PairSink<'o, F>),
) {
    walk(&mut sink);
    sink.finish();
}
