//! A mask that another process has written: box count, encoding, lengths of its sections, and words.

use pairmask_core::engine::{AvailableIsa, Isa};
use pairmask_core::mask::{Encoding, MaskError, MaskShape, MaskView, Span, WordAddress};
use pairmask_core::units::BoxCount;
use pairmask_tests::naive_decoder;

use crate::input::Input;

/// Boxes of a mask at most: dense words of all their pairs are some hundred.
const MOST_BOXES: u32 = 80;
/// Pairs that are compared in the order that they have; what else is the same of longer masks too.
const MOST_PAIRS: usize = 1 << 14;

pub fn decode(data: &[u8]) {
    let mut input = Input(data);
    let n = BoxCount::new(input.below(MOST_BOXES));
    let kind = input.byte();
    let (lie, len) = (kind & 0x80 != 0, u64::from(input.byte()));
    let encoding = Encoding::ALL[usize::from(kind) % Encoding::ALL.len()];
    let mut shape = MaskShape::exact(encoding, n, len, kind & 0x40 != 0);
    if lie {
        change_span(&mut shape, &mut input);
    }
    let words = words(&mut input, &shape, kind & 0x20 != 0);
    check(n, &shape, &words);
}

/// Moves or lengthens a section, up to the largest numbers.
fn change_span(shape: &mut MaskShape, input: &mut Input<'_>) {
    let which = input.byte();
    let span = match shape {
        MaskShape::Dense { words } => words,
        MaskShape::Sparse { rows, blocks, bits, order } => match which % 4 {
            0 => rows,
            1 => blocks,
            2 => bits,
            _ => order.get_or_insert_default(),
        },
        MaskShape::List { pairs } => pairs,
        _ => return,
    };
    let number = |input: &mut Input<'_>| match input.number() {
        u32::MAX => u64::MAX,
        number => number.into(),
    };
    *span = Span { start: number(input), len: number(input) };
}

/// Words for a mask, whole ones or small numbers; a little less than it needs where the input ends.
fn words(input: &mut Input<'_>, shape: &MaskShape, whole: bool) -> Vec<u32> {
    let count = shape.extent_words().min(1 << 12) as u32;
    let mut words = input.some(count, |input| if whole { input.word() } else { input.number() });
    if input.flag() {
        words.resize(count as usize, 0);
    }
    words
}

/// Decodes a mask in all ways. They agree with one another, and with the naive decoder where that finds no mistake.
pub fn check(n: BoxCount, shape: &MaskShape, words: &[u32]) {
    let Ok(mask) = MaskView::new(n, shape, words) else {
        assert!(naive_decoder::decode(words, shape, n.get()).is_err(), "a right mask is refused");
        return;
    };
    let mut pairs = mask.to_vec();
    for [a, b] in &pairs {
        assert!(a < b && *b < n.get(), "[{a}, {b}] of {n:?}");
    }
    assert!(mask.count() >= pairs.len() as u64, "fewer counted than there are");
    for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
        let mask = mask.with_isa(isa);
        assert_eq!(mask.to_vec(), pairs, "{isa}");
        assert!(mask.pairs().take(MOST_PAIRS).eq(pairs.iter().copied().take(MOST_PAIRS)), "{isa}");
    }
    let mut in_words = 0;
    for word in mask.words() {
        in_words += u64::from(word.bits.count());
        if let WordAddress::Sparse { row, block } = word.address {
            assert!(row < n.get() && block < n.column_blocks());
        }
    }
    assert!(in_words >= pairs.len() as u64, "pairs that no word has");

    let naive = naive_decoder::decode(words, shape, n.get());
    match (mask.verify(), naive) {
        (Ok(()), Ok(naive)) => {
            assert_eq!(mask.count(), pairs.len() as u64);
            pairs.sort_unstable();
            assert_eq!(pairs, naive);
            if let [first, ..] = pairs[..] {
                assert!(mask.contains(first[1], first[0]));
            }
        }
        (Err(_), Err(_)) => {}
        (verified, naive) => panic!("{verified:?}, naively {:?}", naive.err() as Option<MaskError>),
    }
    let last = n.get().saturating_sub(1);
    for (a, b) in [(0, last), (last, 1), (0, 0), (n.get(), 0), (u32::MAX, u32::MAX - 1)] {
        let is_pair = mask.contains(a, b);
        assert!(!is_pair || (a != b && a.max(b) < n.get()));
    }
}
