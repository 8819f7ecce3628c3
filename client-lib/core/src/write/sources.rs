//! Boxes as two arrays of points: corners, or centres and half extents.

use super::BoxSource;
use super::columns::write_columns;
use crate::aabb::Aabb;
use crate::floats;

/// Three arrays of one length: x, y and z of each point.
pub type Columns<'a> = [&'a [f32]; 3];

/// Boxes by their corners, as they are: no sorting, `min > max` means empty.
#[derive(Clone, Copy, Debug)]
pub struct MinMax<L>(Pairs<L>);

/// Boxes by centres and half extents: `center − half` to `center + half`.
///
/// Both are rounded to nearest, as [`Aabb::from_center_half`] does. A negative half extent makes a box
/// empty, unless it is so small beside the centre that both faces round to the same number. A NaN, and
/// an infinite centre with an infinite half extent, make a box invalid. A finite centre with an
/// infinite half extent reaches from −∞ to +∞.
#[derive(Clone, Copy, Debug)]
pub struct CenterHalf<L>(Pairs<L>);

impl<'a> MinMax<Columns<'a>> {
    /// Corners as six arrays: x, y and z of the smallest and of the largest corners.
    ///
    /// # Panics
    /// When the arrays differ in length.
    pub fn columns(min: Columns<'a>, max: Columns<'a>) -> Self {
        Self(Pairs::of_columns(min, max))
    }
}

impl<'a, V: Copy + Into<[f32; 3]> + Sync> MinMax<&'a [V]> {
    /// Corners as two arrays of `[f32; 3]`, or of vectors that convert into it.
    ///
    /// # Panics
    /// When the arrays differ in length.
    pub fn points(min: &'a [V], max: &'a [V]) -> Self {
        Self(Pairs::of_points(min, max))
    }
}

impl<'a> CenterHalf<Columns<'a>> {
    /// Centres and half extents as six arrays: x, y and z of each.
    ///
    /// # Panics
    /// When the arrays differ in length.
    pub fn columns(center: Columns<'a>, half: Columns<'a>) -> Self {
        Self(Pairs::of_columns(center, half))
    }
}

impl<'a, V: Copy + Into<[f32; 3]> + Sync> CenterHalf<&'a [V]> {
    /// Centres and half extents as two arrays of `[f32; 3]`, or of vectors that convert into it.
    ///
    /// # Panics
    /// When the arrays differ in length.
    pub fn points(center: &'a [V], half: &'a [V]) -> Self {
        Self(Pairs::of_points(center, half))
    }
}

impl<L: Layout> BoxSource for MinMax<L> {
    fn len(&self) -> usize {
        self.0.first.len()
    }

    fn write_range(&self, first: usize, out: &mut [Aabb]) {
        let Pairs { first: min, second: max } = self.0.range(first, out.len());
        L::write_corners(min, max, out);
    }
}

impl<L: Layout> BoxSource for CenterHalf<L> {
    fn len(&self) -> usize {
        self.0.first.len()
    }

    fn write_range(&self, first: usize, out: &mut [Aabb]) {
        let Pairs { first: center, second: half } = self.0.range(first, out.len());
        floats::with_default(|| L::write_centered(center, half, out));
    }
}

/// Two points for each box. Both arrays are of one length.
#[derive(Clone, Copy, Debug)]
struct Pairs<L> {
    first: L,
    second: L,
}

impl<'a> Pairs<Columns<'a>> {
    fn of_columns(first: Columns<'a>, second: Columns<'a>) -> Self {
        let n = first[0].len();
        assert!(
            first.iter().chain(&second).all(|column| column.len() == n),
            "arrays of one length"
        );
        Self { first, second }
    }
}

impl<'a, V> Pairs<&'a [V]> {
    fn of_points(first: &'a [V], second: &'a [V]) -> Self {
        assert_eq!(first.len(), second.len(), "arrays of one length");
        Self { first, second }
    }
}

impl<L: Layout> Pairs<L> {
    /// The points of `n` boxes from `start` on.
    fn range(&self, start: usize, n: usize) -> Self {
        Self { first: self.first.range(start, n), second: self.second.range(start, n) }
    }
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Columns<'_> {}
    impl<V> Sealed for &[V] {}
}

/// A layout of points in memory: [`Columns`], or a slice of vectors.
#[allow(clippy::len_without_is_empty, reason = "the methods are not for users")]
pub trait Layout: Copy + Sync + sealed::Sealed {
    /// Number of points.
    #[doc(hidden)]
    fn len(&self) -> usize;

    /// `n` points from `start` on.
    #[doc(hidden)]
    #[must_use]
    fn range(self, start: usize, n: usize) -> Self;

    /// Writes boxes by their corners. All lengths are the same.
    #[doc(hidden)]
    fn write_corners(min: Self, max: Self, out: &mut [Aabb]);

    /// Writes boxes around centres, on a thread with the default flags. All lengths are the same.
    #[doc(hidden)]
    fn write_centered(center: Self, half: Self, out: &mut [Aabb]);
}

impl Layout for Columns<'_> {
    fn len(&self) -> usize {
        self[0].len()
    }

    fn range(self, start: usize, n: usize) -> Self {
        self.map(|column| &column[start..][..n])
    }

    fn write_corners(min: Self, max: Self, out: &mut [Aabb]) {
        write_columns(min, max, out, |min, max| (min, max));
    }

    fn write_centered(center: Self, half: Self, out: &mut [Aabb]) {
        write_columns(center, half, out, faces);
    }
}

impl<V: Copy + Into<[f32; 3]> + Sync> Layout for &[V] {
    fn len(&self) -> usize {
        (**self).len()
    }

    fn range(self, start: usize, n: usize) -> Self {
        &self[start..][..n]
    }

    fn write_corners(min: Self, max: Self, out: &mut [Aabb]) {
        for ((min, max), out) in min.iter().zip(max).zip(out) {
            let ([x, y, z], [u, v, w]): ([f32; 3], [f32; 3]) = ((*min).into(), (*max).into());
            *out = Aabb { min: [x, y, z], max: [u, v, w] };
        }
    }

    fn write_centered(center: Self, half: Self, out: &mut [Aabb]) {
        for ((center, half), out) in center.iter().zip(half).zip(out) {
            *out = Aabb::from_center_half(*center, *half);
        }
    }
}

/// The faces of intervals around centres.
#[inline(always)]
fn faces<const N: usize>(center: [f32; N], half: [f32; N]) -> ([f32; N], [f32; N]) {
    (std::array::from_fn(|k| center[k] - half[k]), std::array::from_fn(|k| center[k] + half[k]))
}
