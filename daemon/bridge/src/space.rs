//! Space, cut into slabs across one axis, each of one machine.
//!
//! Slab `k` holds the coordinates from cut `k - 1` on, and below cut `k`: each coordinate is in one slab. Who owns the
//! slab of the lower corner of a pair's intersection reports the pair.

use std::ops::RangeInclusive;

use crate::state::BoxState;

/// Numbers by which a bridge says where along the axis its boxes are: `QUANTILES - 1` parts of equal counts. Sixteen
/// parts place a cut within a sixteenth of the boxes of a machine.
pub const QUANTILES: usize = 17;

/// How a bridge's own boxes are spread along the axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Boxes that may be pairs.
    pub count: u32,
    /// The lowest of their lower corners, those at each sixteenth of the boxes, and the highest.
    pub quantiles: [f32; QUANTILES],
}

impl Spread {
    /// Of lower corners, in any order. Infinite ones are left out: no cut is placed by them.
    pub fn of(mut corners: Vec<f32>) -> Self {
        corners.retain(|x| x.is_finite());
        corners.sort_unstable_by(f32::total_cmp);
        let mut quantiles = [0.0; QUANTILES];
        if let Some(last) = corners.len().checked_sub(1) {
            for (k, at) in quantiles.iter_mut().enumerate() {
                *at = corners[last * k / (QUANTILES - 1)];
            }
        }
        Self { count: corners.len() as u32, quantiles }
    }

    fn median(&self) -> f32 {
        self.quantiles[QUANTILES / 2]
    }

    /// Boxes below a coordinate, by straight lines between quantiles.
    fn below(&self, x: f32) -> f64 {
        let part = f64::from(self.count) / (QUANTILES - 1) as f64;
        let parts: f64 = self
            .quantiles
            .windows(2)
            .map(|ends| {
                let (low, high) = (f64::from(ends[0]), f64::from(ends[1]));
                if f64::from(x) >= high {
                    1.0
                } else {
                    ((f64::from(x) - low) / (high - low)).clamp(0.0, 1.0)
                }
            })
            .sum();
        part * parts
    }
}

/// The slabs, and whose they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// 0 for x, 1 for y, 2 for z.
    pub axis: u8,
    /// Where one slab ends and the next begins, rising; one fewer than slabs.
    pub cuts: Vec<f32>,
    /// The owner of each slab: a place in the members of the view.
    pub owners: Vec<u16>,
}

impl Space {
    /// One slab of one owner.
    pub fn whole(axis: u8) -> Self {
        Self { axis, cuts: Vec::new(), owners: vec![0] }
    }

    /// Slabs of equal counts of boxes, given how the boxes of each member are spread. Members own them in the order of
    /// their medians, so that most boxes are in the slab of the machine that writes them.
    pub fn balanced(axis: u8, spreads: &[Spread]) -> Self {
        let mut owners: Vec<u16> = (0..spreads.len() as u16).collect();
        let median = |member: &u16| {
            let spread = &spreads[usize::from(*member)];
            // Where a machine has no boxes yet, its slab is the last.
            if spread.count == 0 { f32::INFINITY } else { spread.median() }
        };
        owners.sort_by(|a, b| median(a).total_cmp(&median(b)).then(a.cmp(b)));
        let all: f64 = spreads.iter().map(|spread| f64::from(spread.count)).sum();
        let mut cuts = Vec::new();
        for k in 1..owners.len() {
            let wanted = all * k as f64 / owners.len() as f64;
            let cut = coordinate_with(spreads, wanted);
            // Slabs of no width are slabs as well: of a machine in a crowd at one place.
            cuts.push(cuts.last().map_or(cut, |last: &f32| last.max(cut)));
        }
        Self { axis, cuts, owners }
    }

    /// The most boxes of a slab as a multiple of what each would have were they equal.
    pub fn imbalance(&self, spreads: &[Spread]) -> f64 {
        let all: f64 = spreads.iter().map(|spread| f64::from(spread.count)).sum();
        let below = |x: f32| spreads.iter().map(|spread| spread.below(x)).sum::<f64>();
        let ends = self.cuts.iter().map(|cut| below(*cut)).chain([all]);
        let (mut last, mut most) = (0.0, 0.0_f64);
        for end in ends {
            most = most.max(end - last);
            last = end;
        }
        if all == 0.0 { 1.0 } else { most * self.owners.len() as f64 / all }
    }

    /// The slab of a coordinate.
    fn slab(&self, x: f32) -> usize {
        self.cuts.partition_point(|cut| *cut <= x)
    }

    /// The member that owns the place of a coordinate.
    pub fn owner(&self, x: f32) -> usize {
        usize::from(self.owners[self.slab(x)])
    }

    /// The slabs that a box is within a margin of; `None` where it can be no pair.
    pub fn slabs_near(&self, state: &BoxState, margin: f32) -> Option<RangeInclusive<usize>> {
        let axis = usize::from(self.axis);
        // To round a difference to the nearest number leaves it no larger than what was subtracted from.
        let (low, high) = (state.aabb.min[axis] - margin, state.aabb.max[axis] + margin);
        state.is_there().then(|| self.slab(low)..=self.slab(high))
    }
}

/// The coordinate that so many boxes are below: by halving between the lowest and the highest one.
fn coordinate_with(spreads: &[Spread], wanted: f64) -> f32 {
    let there = || spreads.iter().filter(|spread| spread.count > 0);
    let low = there().map(|spread| spread.quantiles[0]).min_by(f32::total_cmp);
    let high = there().map(|spread| spread.quantiles[QUANTILES - 1]).max_by(f32::total_cmp);
    let (Some(low), Some(high)) = (low, high) else { return 0.0 };
    let (mut low, mut high) = (f64::from(low), f64::from(high));
    // 48 halvings are finer than f32.
    for _ in 0..48 {
        let middle = f64::midpoint(low, high);
        let below: f64 = spreads.iter().map(|spread| spread.below(middle as f32)).sum();
        if below < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    high as f32
}

#[cfg(test)]
mod tests {
    use pairmask_core::Aabb;

    use super::*;

    fn spread(from: f32, to: f32, count: u32) -> Spread {
        let corners = (0..count).map(|k| from + (to - from) * k as f32 / count as f32);
        Spread::of(corners.collect())
    }

    #[test]
    fn each_coordinate_has_one_owner() {
        let space = Space { axis: 0, cuts: vec![-1.0, 0.0, 0.0, 5.0], owners: vec![3, 1, 4, 0, 2] };
        let at = [f32::NEG_INFINITY, -1.5, -1.0, -0.0, 0.0, 4.9, 5.0, f32::INFINITY];
        assert_eq!(at.map(|x| space.owner(x)), [3, 3, 1, 0, 0, 0, 2, 2]);
        let state = BoxState::from(Aabb::new([-1.25, 0.0, 0.0], [0.0, 1.0, 1.0]));
        assert_eq!(space.slabs_near(&state, 0.0), Some(0..=3));
        assert_eq!(space.slabs_near(&state, 5.0), Some(0..=4));
        let disabled = BoxState { is_enabled: false, ..state };
        assert_eq!(space.slabs_near(&disabled, 5.0), None);
        assert_eq!(space.slabs_near(&Aabb::EMPTY.into(), 5.0), None);
    }

    #[test]
    fn cuts_follow_density() {
        let spreads = [spread(100.0, 200.0, 3_000), spread(0.0, 100.0, 1_000)];
        let space = Space::balanced(0, &spreads);
        assert_eq!(space.owners, [1, 0]);
        // 1,000 boxes below 100, and 1,000 of the 3,000 above.
        assert!((space.cuts[0] - 133.3).abs() < 5.0, "{space:?}");
        assert!(space.imbalance(&spreads) < 1.02);
        let halves = Space { cuts: vec![100.0], ..space };
        assert!((halves.imbalance(&spreads) - 1.5).abs() < 0.05);
    }

    #[test]
    fn machines_without_boxes_and_crowds_at_one_place_have_slabs() {
        let none = Space::balanced(2, &[Spread::default(); 3]);
        assert_eq!((none.cuts.len(), none.owners.len()), (2, 3));
        let one_place = Space::balanced(2, &[spread(7.0, 7.0, 50), spread(7.0, 7.0, 10)]);
        assert!(one_place.cuts[0].is_finite());
        assert!(Spread::of(vec![f32::INFINITY, 1.0, f32::NAN]).count == 1);
    }
}
