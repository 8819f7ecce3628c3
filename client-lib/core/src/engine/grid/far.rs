//! Few boxes far from all others: what lies near, without them.

/// Positions that the spread is taken from, where it is only to show whether some lie far away.
const SPREAD_BOXES: usize = 64;
/// Extent in mean distances from the mean at which some positions may lie far away: evenly spread ones have 4, and
/// those of which three in ten lie far away 13. Where none does, as in a normal distribution, which has 8, it takes a
/// selection to see it.
const FAR_EXTENT: f32 = 6.0;
/// Share of the positions, on either side, that may lie far away: one in so many.
const FAR_SHARE: usize = 5;
/// What is not far lies within so many extents of the others, on either side of them.
const NEAR_EXTENTS: f32 = 4.0;

/// The smallest and the largest of some finite positions within bounds without those that lie far from all others;
/// `None` where none does. Needs the default floating-point flags.
pub fn near_bounds(
    (low, high): (f32, f32),
    positions: impl Iterator<Item = f32> + Clone,
    scratch: &mut Vec<f32>,
) -> Option<(f32, f32)> {
    let count = positions.clone().count();
    let step = count.div_ceil(SPREAD_BOXES).max(1);
    let some = || positions.clone().step_by(step);
    let weight = 1.0 / count.div_ceil(step).max(1) as f32;
    let mean: f32 = some().map(|x| weight * x).sum();
    let spread: f32 = some().map(|x| weight * (x - mean).abs()).sum();
    // Infinite, where positions are as far apart as can be, is far.
    if count == 0 || high - low <= FAR_EXTENT * spread {
        return None;
    }
    scratch.clear();
    scratch.extend(positions);
    let far = count / FAR_SHARE;
    let inner_low = *scratch.select_nth_unstable_by(far, f32::total_cmp).1;
    let inner_high = *scratch.select_nth_unstable_by(count - 1 - far, f32::total_cmp).1;
    let extent = NEAR_EXTENTS * (inner_high - inner_low);
    let is_near = |x: f32| (inner_low - extent..=inner_high + extent).contains(&x);
    let near = scratch.iter().copied().filter(|x| is_near(*x));
    let found = near.fold((inner_low, inner_high), |(low, high), x| (low.min(x), high.max(x)));
    (found != (low, high)).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(positions: &[f32]) -> Option<(f32, f32)> {
        let low = positions.iter().copied().fold(f32::INFINITY, f32::min);
        let high = positions.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        near_bounds((low, high), positions.iter().copied(), &mut Vec::new())
    }

    #[test]
    fn few_positions_far_away_do_not_count() {
        let even: Vec<f32> = (0..1_000).map(|i| (i * 37 % 1_000) as f32).collect();
        for far in [-1e7, 1e9, f32::MIN, f32::MAX] {
            for count in [1, 20] {
                let mut positions = even.clone();
                (0..count).for_each(|i| positions[41 * i + 5] = far);
                let (low, high) = bounds(&positions).expect("some lie far away");
                assert!((0.0..20.0).contains(&low) && (980.0..1_000.0).contains(&high));
            }
        }
    }

    #[test]
    fn what_is_spread_evenly_or_in_clusters_stays() {
        let even: Vec<f32> = (0..1_000).map(|i| (i * 37 % 1_000) as f32).collect();
        let two_sites = even.iter().map(|x| if *x < 300.0 { *x } else { 1e6 + x }).collect();
        let one_site = vec![5.0; 100];
        for positions in [even, two_sites, one_site, vec![7.0], Vec::new()] {
            assert_eq!(bounds(&positions), None);
        }
    }
}
