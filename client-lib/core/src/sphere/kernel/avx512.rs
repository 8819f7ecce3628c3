//! The filter with AVX-512: 8 columns a comparison, whose answer is 8 mask bits as they are.
#![allow(unsafe_code)]
// A dozen intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::{Take, Verdict, search_with};
use crate::engine::{AvailableIsa, Isa};
use crate::sphere::columns::{BallColumns, Columns, WORD_COLUMNS};
use crate::sphere::exact::{Ball, LESS};

/// 8 values of a column.
#[inline]
#[target_feature(enable = "avx512f")]
fn load(column: &[f64; WORD_COLUMNS], first: usize) -> __m512d {
    let values = &column[first..first + 8];
    // SAFETY: the slice is 8 f64, 64 bytes.
    unsafe { _mm512_loadu_pd(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn test(ball: &Ball, columns: &Columns<'_>) -> Verdict {
    let center = ball.center.map(|x| _mm512_set1_pd(x));
    let (radius, less) = (_mm512_set1_pd(ball.radius), _mm512_set1_pd(LESS));
    let mut verdict = Verdict::default();
    for first in (0..WORD_COLUMNS).step_by(8) {
        let [dx, dy, dz] =
            std::array::from_fn(|axis| _mm512_sub_pd(center[axis], load(columns[axis], first)));
        // Fewer roundings than the filter allows for.
        let distance = _mm512_fmadd_pd(dz, dz, _mm512_fmadd_pd(dy, dy, _mm512_mul_pd(dx, dx)));
        let reach = _mm512_add_pd(radius, load(columns[3], first));
        let reach = _mm512_mul_pd(reach, reach);
        // Ordered comparisons: a NaN, which is a sphere that overlaps nothing, is never in.
        let hits = _mm512_cmp_pd_mask::<_CMP_LE_OQ>(distance, _mm512_mul_pd(reach, less));
        let near = _mm512_cmp_pd_mask::<_CMP_LE_OQ>(_mm512_mul_pd(distance, less), reach);
        verdict.hits |= u64::from(hits) << first;
        verdict.ties |= u64::from(near) << first;
    }
    verdict.ties &= !verdict.hits;
    verdict
}

/// [`super::search`] with this instruction set.
pub(super) fn search(columns: &BallColumns, row: usize, isa: AvailableIsa, take: &mut impl Take) {
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
    fn run(columns: &BallColumns, row: usize, take: &mut impl Take) {
        // The closure inherits the features of this function.
        search_with(columns, row, take, |ball, columns| test(ball, columns));
    }
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of this set exists only where the CPU reported its features.
    unsafe { run(columns, row, take) }
}
