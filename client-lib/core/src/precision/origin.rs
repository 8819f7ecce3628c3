//! World coordinates in f64 → boxes in f32 around an origin, rounded outward.

use crate::aabb::Aabb;
use crate::floats;

impl Aabb {
    /// The box from `min` to `max`, given in f64, relative to `origin`: the tightest f32 box that
    /// contains it, up to one unit in the last place.
    ///
    /// Steps of f32 are 64 m at 1e9 m. Relative to an origin near them, boxes keep their precision.
    /// All boxes of a frame need the same origin: then no overlapping pair is lost. A pair is extra
    /// only where its gap is below a step of f32 at each of its two faces, at their distance from
    /// the origin ([`Widening::Origin`](crate::precision::Widening::Origin)).
    ///
    /// A NaN (also in `origin`, also an origin at infinity) gives an invalid box, which a reply counts;
    /// otherwise `min > max` on an axis gives [`Aabb::EMPTY`]. Infinite coordinates stay infinite.
    ///
    /// # Why it contains the exact box
    ///
    /// d = fl(x − origin) is the f64 nearest to the exact difference, and e = (x − origin) − d is
    /// known exactly (two-sum, Knuth). r = the f32 nearest to d, moved one step outward where it is
    /// on the wrong side of d. Where r ≠ d, a whole step of f64 lies between r and d, and the exact
    /// difference is within half a step of d. Where r = d, the sign of e shows on which side the
    /// exact difference is.
    ///
    /// All of it is computed with the default floating-point flags, regardless of those of this thread: the
    /// boxes of a frame may come from several threads, and r is one function of x for all of them.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// let (min, max, origin) = ([1e9 + 0.25; 3], [1e9 + 1.25; 3], [1e9; 3]);
    /// let b = Aabb::outward_from_f64(min, max, origin);
    /// assert_eq!(b, Aabb::from([0.25, 0.25, 0.25, 1.25, 1.25, 1.25]));
    /// ```
    pub fn outward_from_f64(
        min: impl Into<[f64; 3]>,
        max: impl Into<[f64; 3]>,
        origin: impl Into<[f64; 3]>,
    ) -> Self {
        let (min, max, origin) = (min.into(), max.into(), origin.into());
        floats::with_default(|| outward_with_default_flags(min, max, origin))
    }
}

fn outward_with_default_flags(min: [f64; 3], max: [f64; 3], origin: [f64; 3]) -> Aabb {
    let is_finite_origin = origin.iter().all(|x| x.is_finite());
    if !is_finite_origin || min.iter().chain(&max).any(|x| x.is_nan()) {
        return Aabb { min: [f32::NAN; 3], max: [f32::NAN; 3] };
    }
    if (0..3).any(|axis| min[axis] > max[axis]) {
        return Aabb::EMPTY;
    }
    Aabb {
        min: std::array::from_fn(|axis| below(min[axis], origin[axis])),
        max: std::array::from_fn(|axis| -below(-max[axis], -origin[axis])),
    }
}

/// An f32 that is not above x − origin: the largest one, or the one before it. `origin` is finite, and
/// `x` no NaN.
fn below(x: f64, origin: f64) -> f32 {
    debug_assert!(floats::are_default(), "boxes are rounded with the default flags");
    let difference = x - origin;
    let rounded = difference as f32;
    if x.is_infinite() {
        return rounded;
    }
    let is_above = match f64::from(rounded).partial_cmp(&difference) {
        Some(std::cmp::Ordering::Less) => false,
        Some(std::cmp::Ordering::Equal) => {
            let error = error_of_difference(x, origin, difference);
            // NaN where the difference overflows f64: then f32::MAX is below it.
            error.is_nan() || error < 0.0
        }
        Some(std::cmp::Ordering::Greater) | None => true,
    };
    if is_above { rounded.next_down() } else { rounded }
}

/// (x − y) − fl(x − y), exactly.
fn error_of_difference(x: f64, y: f64, difference: f64) -> f64 {
    let virtual_y = x - difference;
    let virtual_x = difference + virtual_y;
    (x - virtual_x) + (virtual_y - y)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::aabb::BoxClass;

    /// k · 2^e as f64, and the same as a whole number of 2⁻⁶⁰.
    fn number() -> impl Strategy<Value = (f64, i128)> {
        prop_oneof![
            (-(1i64 << 53)..=1 << 53, 0u32..=60),
            (-(1i64 << 24)..=1 << 24, 30u32..=60),
            (-8i64..=8, 50u32..=60),
        ]
        .prop_map(|(k, e)| (k as f64 * 2.0f64.powi(-(e as i32)), i128::from(k) << (60 - e)))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn the_box_contains_the_exact_one_and_no_step_more(
            (x, exact_x) in number(),
            (origin, exact_origin) in number(),
        ) {
            let exact = exact_x - exact_origin;
            let b = Aabb::outward_from_f64([x; 3], [x; 3], [origin; 3]);
            // An f32 as a whole number of 2⁻¹⁴⁹ would not fit; compare by sign of the difference.
            let side = |r: f32| {
                let scaled = f64::from(r) * 2.0f64.powi(60);
                (scaled.floor() as i128, scaled.ceil() as i128)
            };
            prop_assert!(side(b.min[0]).1 <= exact, "{x:e} - {origin:e} in {b:?}");
            prop_assert!(side(b.max[0]).0 >= exact, "{x:e} - {origin:e} in {b:?}");
            // One step inward on either side loses the exact value, or reaches it.
            prop_assert!(side(b.min[0].next_up()).1 >= exact);
            prop_assert!(side(b.max[0].next_down()).0 <= exact);
        }
    }

    #[test]
    fn integers_are_exact_and_extremes_go_outward() {
        let origin = [1e9; 3];
        let exact = Aabb::outward_from_f64([1e9 + 3.0; 3], [1e9 + 4.0; 3], origin);
        assert_eq!(exact, Aabb::from([3.0, 3.0, 3.0, 4.0, 4.0, 4.0]));
        let huge = Aabb::outward_from_f64([-1e300; 3], [1e300; 3], [0.0; 3]);
        assert_eq!((huge.min[0], huge.max[0]), (f32::NEG_INFINITY, f32::INFINITY));
        let inward = Aabb::outward_from_f64([1e300; 3], [1e300; 3], [0.0; 3]);
        assert_eq!((inward.min[0], inward.max[0]), (f32::MAX, f32::INFINITY));
        let overflow = [f64::MAX; 3];
        let beyond = Aabb::outward_from_f64(overflow, overflow, [f64::MIN; 3]);
        assert_eq!((beyond.min[0], beyond.max[0]), (f32::MAX, f32::INFINITY));
        let tiny = Aabb::outward_from_f64([1e-300; 3], [1e-300; 3], [0.0; 3]);
        assert_eq!((tiny.min[0], tiny.max[0]), (0.0, f32::from_bits(1)));
    }

    #[test]
    fn classes_survive() {
        let at = |min: f64, max: f64, origin: f64| {
            Aabb::outward_from_f64([min; 3], [max; 3], [origin; 3]).class()
        };
        assert_eq!(at(1.0f64.next_up(), 1.0, 0.0), BoxClass::Empty, "f32 would make it valid");
        assert_eq!(at(f64::NAN, 1.0, 0.0), BoxClass::Invalid);
        assert_eq!(at(0.0, 1.0, f64::NAN), BoxClass::Invalid);
        assert_eq!(at(f64::INFINITY, f64::INFINITY, f64::INFINITY), BoxClass::Invalid);
        for origin in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
            for (min, max) in [(0.0, 1.0), (f64::NEG_INFINITY, f64::INFINITY), (1.0, 0.0)] {
                assert_eq!(at(min, max, origin), BoxClass::Invalid, "{min} to {max} from {origin}");
            }
        }
        assert_eq!(at(f64::NEG_INFINITY, f64::INFINITY, 7.0), BoxClass::Valid);
    }
}
