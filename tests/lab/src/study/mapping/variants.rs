//! The variants and their square roots in Rust, stage-faithful to the WGSL of the same name: same f32 operations in the
//! same order, integers of 64 bits.
//!
//! A variant answers with two box numbers, counted from 0, that need not be a pair: the study
//! counts those that are none. The paper counts boxes from 1, and so does the inside of [`closed`].

use pairmask_core::pair_index::row_start;
use pairmask_core::{BoxCount, PairIndex};

use super::stage::Variant;

/// √x as x · 1/√x: a first guess from the bits of x, then `STEPS` steps of Newton (§3.3, after Quake III).
#[inline(always)]
pub fn newton<const MAGIC: u32, const STEPS: u32>(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(MAGIC.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..STEPS {
        y *= 1.5 - half * y * y;
    }
    x * y
}

/// Work on a root, compiled for each root with the root inlined, so that times are those of the root.
macro_rules! with_root {
    ($root:expr, $name:ident => $work:expr) => {{
        use $crate::study::mapping::stage::{Magic, Root};
        use $crate::study::mapping::variants::newton;
        const CARMACK: u32 = Magic::Carmack as u32;
        const LOMONT: u32 = Magic::Lomont as u32;
        macro_rules! of {
            ($by:expr) => {{
                let $name = $by;
                $work
            }};
        }
        match $root {
            Root::BuiltIn => of!(f32::sqrt),
            Root::Newton(Magic::Carmack, 1) => of!(newton::<CARMACK, 1>),
            Root::Newton(Magic::Carmack, 2) => of!(newton::<CARMACK, 2>),
            Root::Newton(Magic::Carmack, 3) => of!(newton::<CARMACK, 3>),
            Root::Newton(Magic::Carmack, _) => of!(newton::<CARMACK, 4>),
            Root::Newton(Magic::Lomont, 1) => of!(newton::<LOMONT, 1>),
            Root::Newton(Magic::Lomont, 2) => of!(newton::<LOMONT, 2>),
            Root::Newton(Magic::Lomont, 3) => of!(newton::<LOMONT, 3>),
            Root::Newton(Magic::Lomont, _) => of!(newton::<LOMONT, 4>),
        }
    }};
}
pub(super) use with_root;

/// A variant's answer to an id: a pair (a, b) if 0 ≤ a < b < n.
pub type Mapped = [i64; 2];

fn mapped(a: u32, b: u32) -> Mapped {
    [i64::from(a), i64::from(b)]
}

/// The boxes of an answer in ascending order, if they are two: a kernel that tests (b, a) has tested (a, b).
pub fn named([a, b]: Mapped, n: BoxCount) -> Option<[u32; 2]> {
    let (a, b) = (a.min(b), a.max(b));
    (a >= 0 && a < b && b < i64::from(n.get())).then_some([a as u32, b as u32])
}

/// Formulas 1 and 2 of Avril et al. 2012, with the corrections of §3.3 if `CORRECTED`.
#[inline(always)]
pub fn closed<const INTEGER: bool, const CORRECTED: bool>(
    n: BoxCount,
    k: u64,
    root: impl Fn(f32) -> f32,
) -> Mapped {
    let discriminant = if INTEGER {
        8.0 * (n.pair_count() - k) as f32 + 1.0
    } else {
        let m = n.get() as f32;
        // Rounding can make it negative near the last pair; it then counts as 0 on every device.
        (4.0 * m * m - 4.0 * m - 8.0 * k as f32 + 1.0).max(0.0)
    };
    let last = i64::from(n.get());
    let mut a = (((2 * last + 1) as f32 - root(discriminant)) * 0.5) as i64;
    // S(a) = (a − 1)(2n − a)/2 is the first id of row a.
    let mut b = a + 1 + k as i64 - (a - 1) * (2 * last - a) / 2;
    if CORRECTED {
        if b > last {
            a += 1;
            b = a + (b - last);
        } else if a >= b {
            b = last - (a - b);
            a -= 1;
        }
    }
    [a - 1, b - 1]
}

/// Closed form from the far end, and one integer fix-up.
///
/// With m pairs after k, the row is the j-th from the end for the largest j with j(j − 1)/2 ≤ m,
/// so j = ⌊(1 + √(8m + 1))/2⌋. No large terms cancel: the f32 value is off by less than one row
/// as long as √(8m) < 2^22, and one step up or down makes it exact.
#[inline(always)]
pub fn far_end(n: BoxCount, k: u64) -> Mapped {
    let triangle = |j: u64| j * j.saturating_sub(1) / 2;
    let after = n.pair_count() - 1 - k;
    let mut j = ((1.0 + (8.0 * after as f32 + 1.0).sqrt()) * 0.5) as u64;
    if triangle(j) > after {
        j -= 1;
    } else if after - triangle(j) >= j {
        j += 1;
    }
    let last = u64::from(n.get()) - 1;
    [last as i64 - j as i64, last as i64 - (after - triangle(j)) as i64]
}

#[inline(always)]
pub fn row_search(n: BoxCount, k: u64) -> Mapped {
    let (mut low, mut high) = (0, n.get() - 1);
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if row_start(n, middle) <= k {
            low = middle;
        } else {
            high = middle;
        }
    }
    mapped(low, low + 1 + (k - row_start(n, low)) as u32)
}

/// A row of the rectangle is a row of the triangle and the one that mirrors it (Navarro et al.).
#[inline(always)]
pub fn fold(n: BoxCount, k: u64) -> Mapped {
    let n = u64::from(n.get());
    // Columns of the rectangle that the triangle folds into: n rounded down to an odd number.
    let width = n - 1 + n % 2;
    let (y, x) = (k / width, k % width);
    let own = n - 1 - y;
    if x < own {
        return mapped(y as u32, (y + 1 + x) as u32);
    }
    let row = width - y - 2 * (n % 2);
    mapped(row as u32, (row + 1 + x - own) as u32)
}

/// One exact inverse a word of 32 ids, then steps.
#[inline(always)]
pub fn word_step(n: BoxCount, k: u64) -> Mapped {
    let first = row_search(n, k - k % 32).map(|index| index as u32);
    (0..k % 32).fold(first, |pair, _| next_pair(n, pair)).map(i64::from)
}

#[inline(always)]
pub fn next_pair(n: BoxCount, [a, b]: [u32; 2]) -> [u32; 2] {
    if b + 1 < n.get() { [a, b + 1] } else { [a + 1, a + 2] }
}

/// (k / n, k % n): no pair unless a < b (§3.2.2).
#[inline(always)]
pub fn lazy(n: BoxCount, k: u64) -> Mapped {
    let n = u64::from(n.get());
    [(k / n) as i64, (k % n) as i64]
}

/// The pair that an id stands for in the variant's own numbering; `None` for ids that the lazy way leaves out.
pub fn truth(variant: Variant, n: BoxCount, k: u64) -> Option<[u32; 2]> {
    match variant {
        Variant::Fold => named(fold(n, k), n),
        Variant::Lazy => Some(lazy(n, k)).filter(|[a, b]| a < b).and_then(|pair| named(pair, n)),
        _ => PairIndex::new(k).pair(n),
    }
}

/// Work on a variant, compiled separately for each variant. There must be two boxes at least wherever the map is called.
macro_rules! with_map {
    ($variant:expr, $name:ident => $work:expr) => {{
        use $crate::study::mapping::stage::Variant;
        use $crate::study::mapping::variants as by;
        macro_rules! closed {
                        ($root:expr, $integer:literal, $corrected:literal) => {
                            by::with_root!($root, root => {
                                let $name = |n, k| by::closed::<$integer, $corrected>(n, k, root);
                                $work
                            })
                        };
                    }
        macro_rules! of {
            ($by:expr) => {{
                let $name = $by;
                $work
            }};
        }
        match $variant {
            Variant::Closed { root, integer, corrected } => match (integer, corrected) {
                (false, false) => closed!(root, false, false),
                (false, true) => closed!(root, false, true),
                (true, false) => closed!(root, true, false),
                (true, true) => closed!(root, true, true),
            },
            Variant::FarEnd => of!(by::far_end),
            Variant::RowSearch => of!(by::row_search),
            Variant::Fold => of!(by::fold),
            Variant::WordStep => of!(by::word_step),
            Variant::Lazy => of!(by::lazy),
        }
    }};
}
pub(super) use with_map;

/// One id by one variant: of two boxes at least.
pub fn map(variant: Variant, n: BoxCount, k: u64) -> Mapped {
    assert!(n.get() > 1 && k < variant.id_count(n.get()), "id {k} of {} boxes", n.get());
    with_map!(variant, map => map(n, k))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fold_and_lazy_name_every_pair_once() {
        for n in (2..70).chain([345]).map(BoxCount::new) {
            for variant in [Variant::Fold, Variant::Lazy] {
                let mut named: Vec<_> = (0..variant.id_count(n.get()))
                    .filter_map(|k| truth(variant, n, k))
                    .filter_map(|[a, b]| PairIndex::of(n, a, b))
                    .collect();
                named.sort_unstable();
                let all: Vec<_> = (0..n.pair_count()).map(PairIndex::new).collect();
                assert_eq!(named, all, "{variant}, {n:?}");
            }
        }
    }
}
