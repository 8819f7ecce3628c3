//! The filter with AVX2: 4 columns a comparison.
#![allow(unsafe_code)]
// A dozen intrinsics by name would not help a reader.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::{Take, Verdict, search_with};
use crate::engine::{AvailableIsa, Isa};
use crate::sphere::columns::{BallColumns, Columns, WORD_COLUMNS};
use crate::sphere::exact::{Ball, LESS};

/// 4 values of a column.
#[inline]
#[target_feature(enable = "avx2")]
fn load(column: &[f64; WORD_COLUMNS], first: usize) -> __m256d {
    let values = &column[first..first + 4];
    // SAFETY: the slice is 4 f64, 32 bytes.
    unsafe { _mm256_loadu_pd(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn test(ball: &Ball, columns: &Columns<'_>) -> Verdict {
    let center = ball.center.map(|x| _mm256_set1_pd(x));
    let (radius, less) = (_mm256_set1_pd(ball.radius), _mm256_set1_pd(LESS));
    let mut verdict = Verdict::default();
    for first in (0..WORD_COLUMNS).step_by(4) {
        let square = |axis: usize| {
            let d = _mm256_sub_pd(center[axis], load(columns[axis], first));
            _mm256_mul_pd(d, d)
        };
        let distance = _mm256_add_pd(_mm256_add_pd(square(0), square(1)), square(2));
        let reach = _mm256_add_pd(radius, load(columns[3], first));
        let reach = _mm256_mul_pd(reach, reach);
        // Ordered comparisons: a NaN, which is a sphere that overlaps nothing, is never in.
        let hits = _mm256_cmp_pd::<_CMP_LE_OQ>(distance, _mm256_mul_pd(reach, less));
        let near = _mm256_cmp_pd::<_CMP_LE_OQ>(_mm256_mul_pd(distance, less), reach);
        verdict.hits |= (_mm256_movemask_pd(hits) as u64) << first;
        verdict.ties |= (_mm256_movemask_pd(near) as u64) << first;
    }
    verdict.ties &= !verdict.hits;
    verdict
}

/// [`super::search`] with this instruction set.
pub(super) fn search(columns: &BallColumns, row: usize, isa: AvailableIsa, take: &mut impl Take) {
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    fn run(columns: &BallColumns, row: usize, take: &mut impl Take) {
        // The closure inherits the features of this function.
        search_with(columns, row, take, |ball, columns| test(ball, columns));
    }
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of this set exists only where the CPU reported its features.
    unsafe { run(columns, row, take) }
}
