//! Whether a box may stay what was sent of it.

use crate::aabb::{Aabb, KeyBox};
use crate::precision::Margin;

/// A box is sent again where a face that was sent lies farther outward than so many margins: its near pairs
/// would be far. A box that moves one way leaves a face two margins behind before it leaves its margin.
const LOOSE_MARGINS: f32 = 4.0;

/// What is sent of a box. With the default floating-point flags.
#[inline]
pub(super) fn to_send(b: &Aabb, margin: Margin) -> Aabb {
    if margin.is_zero() { *b } else { margin.inflate_with_default_flags(b) }
}

/// Whether the box lies within what was sent of it, and not far within. With the default floating-point
/// flags.
///
/// A box that has become empty or invalid does not fit a valid one, nor the other way round:
/// [`KeyBox::NOTHING`] lies within every box, and no valid box within it.
#[inline]
pub(super) fn fits(sent: &Aabb, now: &Aabb, margin: Margin) -> bool {
    let (sent, key) = (KeyBox::from(sent), KeyBox::from(now));
    if margin.is_zero() {
        return sent == key;
    }
    let loose = || KeyBox::from(&margin.times(LOOSE_MARGINS).inflate_with_default_flags(now));
    is_within(&key, &sent) && is_within(&sent, &loose())
}

#[inline]
fn is_within(inner: &KeyBox, outer: &KeyBox) -> bool {
    (0..3).all(|axis| outer.min[axis] <= inner.min[axis] && inner.max[axis] <= outer.max[axis])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::aabb::BoxClass;

    fn margin(units: f32) -> Margin {
        Margin::new(units).expect("not negative")
    }

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![
            -20.0f32..20.0,
            -1e-40f32..1e-40,
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(f32::NEG_INFINITY),
            Just(f32::MAX),
            Just(-0.0),
        ]
    }

    fn any_box() -> impl Strategy<Value = Aabb> {
        let corner = || prop::array::uniform3(coordinate());
        (corner(), corner()).prop_map(|(min, max)| Aabb { min, max })
    }

    fn any_margin() -> impl Strategy<Value = Margin> {
        prop_oneof![
            Just(0.0f32),
            Just(-0.0),
            Just(1e-45),
            Just(f32::MAX),
            0.0f32..1.0,
            0.0f32..50.0
        ]
        .prop_map(margin)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn what_is_sent_fits_the_box_itself(b in any_box(), margin in any_margin()) {
            let sent = to_send(&b, margin);
            prop_assert!(fits(&sent, &b, margin));
            prop_assert_eq!(sent.class(), b.class());
            if margin.is_zero() {
                prop_assert_eq!(sent.min.map(f32::to_bits), b.min.map(f32::to_bits));
            }
        }

        #[test]
        fn a_box_that_fits_overlaps_what_it_did_not_before_only_as_its_sent_self_does(
            was in any_box(), by in prop::array::uniform6(-3.0f32..3.0), margins in (any_margin(), any_margin()),
            other in any_box(),
        ) {
            let corner = |corner: [f32; 3], by: &[f32]| std::array::from_fn(|axis| corner[axis] + by[axis]);
            let now = Aabb { min: corner(was.min, &by[..3]), max: corner(was.max, &by[3..]) };
            let sent = to_send(&was, margins.0);
            if fits(&sent, &now, margins.1) {
                prop_assert!(!now.overlaps(&other) || sent.overlaps(&other));
                prop_assert_eq!(sent.class() == BoxClass::Valid, now.class() == BoxClass::Valid);
            }
        }
    }

    #[test]
    fn a_box_that_moves_within_its_margin_fits_and_one_beyond_does_not() {
        let at = |x: f32, edge: f32| Aabb::new([x, 0.0, 0.0], [x + edge, 1.0, 1.0]);
        let sent = to_send(&at(0.0, 1.0), margin(0.5));
        assert!([-0.5, 0.1, 0.5].iter().all(|x| fits(&sent, &at(*x, 1.0), margin(0.5))));
        assert!([-0.51, 0.51].iter().all(|x| !fits(&sent, &at(*x, 1.0), margin(0.5))));
        // Grown; shrunk a little and much; with a smaller margin.
        assert!(!fits(&sent, &at(0.0, 1.6), margin(0.5)));
        let wide = to_send(&at(0.0, 9.0), margin(0.5));
        assert!(
            fits(&wide, &at(0.0, 8.0), margin(0.5)) && !fits(&wide, &at(0.0, 7.0), margin(0.5))
        );
        assert!(
            fits(&sent, &at(0.0, 1.0), margin(0.2)) && !fits(&sent, &at(0.0, 1.0), margin(0.1))
        );
        assert!(!fits(&sent, &at(0.0, 1.0), margin(0.0)));
    }
}
