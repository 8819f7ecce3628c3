//! The filter in plain Rust, in a form that compilers turn into whatever SIMD they have.

use super::Verdict;
use crate::sphere::columns::{Columns, WORD_COLUMNS};
use crate::sphere::exact::{Ball, LESS};

/// Tests 64 columns.
#[inline(always)]
pub(super) fn test(ball: &Ball, columns: &Columns<'_>) -> Verdict {
    let [x, y, z, radius] = columns;
    let (mut near, mut hits) = ([false; WORD_COLUMNS], [false; WORD_COLUMNS]);
    for t in 0..WORD_COLUMNS {
        let (dx, dy, dz) = (ball.center[0] - x[t], ball.center[1] - y[t], ball.center[2] - z[t]);
        let distance = dx * dx + dy * dy + dz * dz;
        let reach = ball.radius + radius[t];
        let reach = reach * reach;
        hits[t] = distance <= reach * LESS;
        near[t] = distance * LESS <= reach;
    }
    let bits = |flags: &[bool; WORD_COLUMNS]| {
        flags.iter().enumerate().fold(0, |bits, (t, flag)| bits | u64::from(*flag) << t)
    };
    let hits = bits(&hits);
    Verdict { hits, ties: bits(&near) & !hits }
}
