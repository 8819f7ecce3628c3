//! Whether a form holds the pairs that the production decoder finds.

use pairmask::MaskView;
use pairmask::oracle::Pair;
use pairmask::oracle::check::{Mismatch, check_pairs};

use super::encoded::Encoded;

/// The pairs of a mask by the production decoder, sorted: what [`check`] compares with.
pub(super) fn expected_pairs(mask: &MaskView<'_>) -> Vec<Pair> {
    let mut pairs = mask.to_vec();
    pairs.sort_unstable();
    pairs
}

/// Compares what a form decodes to with sorted pairs.
///
/// # Errors
/// [`Mismatch`] with the first pair that is missing, extra or there twice.
pub fn check(encoded: &Encoded<'_>, expected: &[Pair]) -> Result<(), Mismatch> {
    let mut pairs = Vec::with_capacity(expected.len());
    encoded.decode(|a, b| pairs.push((a, b)));
    pairs.sort_unstable();
    check_pairs(&pairs, expected)
}

#[cfg(test)]
mod tests {
    use pairmask::BoxCount;
    use pairmask::mask::MaskShape;

    use super::super::encoded::Words;
    use super::super::packed::PackedWords;
    use super::super::prefix::PrefixWords;
    use super::super::words64::LongWords;
    use super::super::{Form, MaskCopy};
    use super::*;

    /// Pairs (0, 1), (0, 33), (0, 65), (3, 4) of 70 boxes, in an order that swaps 1 and 2.
    fn with_mask(judge: impl FnOnce(&MaskCopy, &[Pair])) {
        let n = BoxCount::new(70);
        let mut reply = vec![0; 48 + 70];
        reply[..4].copy_from_slice(&[0, 0, 0, 3]);
        reply[16..20].copy_from_slice(&[0, 1, 2, 0]);
        reply[32..36].copy_from_slice(&[0b100, 0b10, 0b10, 0b1_0000]);
        for (position, index) in (0..).zip(&mut reply[48..]) {
            *index = position;
        }
        reply.swap(49, 50);
        let view =
            MaskView::new(n, &MaskShape::sparse(n, 4, 4, true), &reply).expect("lengths that fit");
        let expected = expected_pairs(&view);
        assert_eq!(expected, [(0, 1), (0, 33), (0, 65), (3, 4)]);
        judge(&MaskCopy::of(&view).expect("a mask that keeps the rules"), &expected);
    }

    #[test]
    fn every_form_holds_the_pairs() {
        with_mask(|mask, expected| {
            for form in Form::ALL {
                let encoded = Encoded::new(form, mask);
                assert_eq!(check(&encoded, expected), Ok(()), "{form:?}");
                let bytes = match form {
                    // Four words of 12 bytes; three of 16, since two share an address.
                    Form::Sparse | Form::Words64 => 48,
                    Form::Prefix => 71 * 4 + 4 * 8,
                    Form::Packed => 4 + 4 * 8,
                    Form::List => 4 * 8,
                };
                assert_eq!(encoded.bytes(), bytes, "{form:?}");
                assert_eq!(encoded.order_bytes(), if form.has_positions() { 280 } else { 0 });
            }
        });
    }

    /// Applies `spoil` to the words of a form, and says whether the check notices.
    fn is_noticed(form: Form, spoil: Spoil) -> bool {
        let mut noticed = false;
        with_mask(|mask, expected| {
            let mut encoded = Encoded::new(form, mask);
            spoil(&mut encoded.words);
            noticed = check(&encoded, expected).is_err();
        });
        noticed
    }

    fn prefix(words: &mut Words) -> &mut PrefixWords {
        let Words::Prefix(words) = words else { panic!("another form: {words:?}") };
        words
    }

    fn long(words: &mut Words) -> &mut LongWords {
        let Words::Long(words) = words else { panic!("another form: {words:?}") };
        words
    }

    fn packed(words: &mut Words) -> &mut PackedWords {
        let Words::Packed(words) = words else { panic!("another form: {words:?}") };
        words
    }

    fn pairs(words: &mut Words) -> &mut Vec<[u32; 2]> {
        let Words::List(list) = words else { panic!("another form: {words:?}") };
        &mut list.pairs
    }

    type Spoil = fn(&mut Words);

    #[test]
    fn the_check_notices_every_spoilt_part() {
        let spoils: [(Form, Spoil); 13] = [
            (Form::Prefix, |words| prefix(words).starts[1] = 2),
            (Form::Prefix, |words| prefix(words).blocks[1] = 2),
            (Form::Prefix, |words| prefix(words).bits[3] = 0b10_0000),
            (Form::Words64, |words| long(words).rows[2] = 2),
            (Form::Words64, |words| long(words).blocks[1] = 0),
            (Form::Words64, |words| long(words).bits[0].swap(0, 1)),
            (Form::Packed, |words| packed(words).starts[0] = 1),
            (Form::Packed, |words| packed(words).low_rows[3] = 2),
            (Form::Packed, |words| packed(words).distances[2] = 0),
            (Form::Packed, |words| packed(words).bits[0] = 0b110),
            (Form::List, |words| pairs(words)[1] = [0, 34]),
            (Form::List, |words| pairs(words)[1] = [0, 1]),
            (Form::List, |words| pairs(words).truncate(3)),
        ];
        for (number, (form, spoil)) in spoils.into_iter().enumerate() {
            assert!(is_noticed(form, spoil), "number {number}, {form:?}");
        }
    }

    #[test]
    fn the_check_notices_another_mask() {
        with_mask(|mask, expected| {
            let mut other = mask.clone();
            other.bits[0] = 0b1000;
            let encoded = Encoded::new(Form::Sparse, &other);
            assert_eq!(check(&encoded, expected), Err(Mismatch::Missing((0, 1))));
            assert_eq!(check(&encoded, &[]), Err(Mismatch::Extra((0, 3))));
        });
    }
}
