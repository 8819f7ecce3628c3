//! Boxes from arrays of coordinates, four at a time.
#![allow(unsafe_code)]

use super::Columns;
use crate::aabb::Aabb;

/// Boxes of a group: a 16-byte register holds one coordinate of each.
const GROUP: usize = 4;

/// One coordinate of each box of a group.
pub type Lane = [f32; GROUP];

/// Writes a box for each pair of points. `corners` makes the smallest and the largest coordinates of a
/// group on one axis. All arrays are as long as `out`.
pub fn write_columns(
    first: Columns<'_>,
    second: Columns<'_>,
    out: &mut [Aabb],
    corners: impl Fn(Lane, Lane) -> (Lane, Lane),
) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "sse2")]
        fn write(
            first: Columns<'_>,
            second: Columns<'_>,
            out: &mut [Aabb],
            corners: impl Fn(Lane, Lane) -> (Lane, Lane),
        ) {
            write_groups(first, second, out, corners, |lanes| x86::interleave(lanes));
        }
        // SAFETY: every x86-64 has SSE2.
        unsafe { write(first, second, out, corners) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    write_groups(first, second, out, corners, interleave);
}

#[inline(always)]
fn write_groups(
    first: Columns<'_>,
    second: Columns<'_>,
    out: &mut [Aabb],
    corners: impl Fn(Lane, Lane) -> (Lane, Lane),
    interleave: impl Fn([Lane; 6]) -> [Aabb; GROUP],
) {
    let n = out.len();
    let (groups, rest) = out.as_chunks_mut::<GROUP>();
    let group_count = groups.len();
    let [a, b, c] = first.map(|column| &column.as_chunks().0[..group_count]);
    let [d, e, f] = second.map(|column| &column.as_chunks().0[..group_count]);
    for (k, out) in groups.iter_mut().enumerate() {
        let [(x, u), (y, v), (z, w)] =
            [corners(a[k], d[k]), corners(b[k], e[k]), corners(c[k], f[k])];
        *out = interleave([x, y, z, u, v, w]);
    }
    if rest.is_empty() {
        return;
    }
    // The last boxes as a group that is filled up.
    let left = |column: &[f32]| {
        let mut lane = Lane::default();
        lane[..rest.len()].copy_from_slice(&column[GROUP * group_count..n]);
        lane
    };
    let (first, second) = (first.map(left), second.map(left));
    let [(x, u), (y, v), (z, w)] = [0, 1, 2].map(|axis| corners(first[axis], second[axis]));
    rest.copy_from_slice(&interleave([x, y, z, u, v, w])[..rest.len()]);
}

/// The packed boxes of `min.x min.y min.z max.x max.y max.z`.
#[cfg(not(target_arch = "x86_64"))]
fn interleave(lanes: [Lane; 6]) -> [Aabb; GROUP] {
    std::array::from_fn(|k| Aabb::from(lanes.map(|lane| lane[k])))
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m128, _mm_movehl_ps, _mm_movelh_ps, _mm_shuffle_ps, _mm_unpackhi_ps, _mm_unpacklo_ps,
    };

    use super::{Aabb, GROUP, Lane};

    /// As the portable one, by twelve shuffles: the compiler finds 24 stores of single floats.
    #[target_feature(enable = "sse2")]
    #[inline]
    pub fn interleave(lanes: [Lane; 6]) -> [Aabb; GROUP] {
        let [x, y, z, u, v, w]: [__m128; 6] = lanes.map(bytemuck::cast);
        let low = two_boxes(_mm_unpacklo_ps(x, y), _mm_unpacklo_ps(z, u), _mm_unpacklo_ps(v, w));
        let high = two_boxes(_mm_unpackhi_ps(x, y), _mm_unpackhi_ps(z, u), _mm_unpackhi_ps(v, w));
        bytemuck::cast([low, high])
    }

    /// Each register has two coordinates of one box, then those of the next.
    #[target_feature(enable = "sse2")]
    #[inline]
    fn two_boxes(xy: __m128, zu: __m128, vw: __m128) -> [__m128; 3] {
        /// The lower half of one register, the upper half of the other.
        const LOW_HIGH: i32 = 0b11_10_01_00;
        [_mm_movelh_ps(xy, zu), _mm_shuffle_ps::<LOW_HIGH>(vw, xy), _mm_movehl_ps(vw, zu)]
    }
}
