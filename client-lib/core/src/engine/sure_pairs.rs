//! How many pairs a scene has at the least: so many that its mask fits no reply is found before any pair is.
//!
//! Boxes that hold the same point overlap one another, so m of them are m(m − 1)/2 pairs. A sample of the boxes says
//! where they lie in crowds: some coordinates on each axis, so that most of the sample holds one of them, span a lattice
//! of points. Each box then counts for one point that it holds, if there is one, which takes some ns.
//!
//! A heap in which each box meets many others, and few hold the same point, has more pairs than that. There a larger sample
//! decides, where its pairs are so many that chance has no part in it: the bound of Hoeffding 1963 for means over pairs.

use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::floats;
use crate::stats::sample_indices;

/// Boxes that are looked at: with fewer, crowds of a tenth of the scene go unseen; more take longer than a frame of
/// 20,000 boxes should wait.
const SAMPLED: usize = 64;
/// Pairs of the sample that are no coincidence: a scene of a million boxes with a few pairs each has one in sixty times.
const SAMPLED_PAIRS: u64 = 2;
/// Most coordinates on an axis: 4,096 points, whose counts are 32 KiB, a first-level cache.
const COORDINATES: usize = 16;
/// Boxes that are counted from one look to the next, whether there are enough pairs and anybody waits for them.
const COUNTED_AT_ONCE: usize = 4_096;
/// Most boxes of the larger sample, whose pairs take some ms to test.
const MANY_SAMPLED: usize = 2_048;
/// Pairs of the larger sample for each box of the scene, twice as many of two sets: those of boxes take a few ns, a tenth
/// of what a frame does.
const SAMPLED_PAIRS_A_BOX: usize = 4;
/// The exponent of the chance that a scene of no more pairs than fit is refused: once in 10^17 scenes.
const NO_CHANCE: f64 = 40.0;
/// A scene is counted where the sample says that it has this share of the pairs, one in so many: it may say too few.
const EXPECTED_SHARE: f64 = 4.0;

/// Something that holds points.
pub(crate) trait Body: Copy {
    /// A box of which it holds all points; one without points where it holds none.
    fn inner(&self) -> Aabb;

    /// Whether it holds a point, exactly.
    fn holds(&self, point: [f32; 3]) -> bool;

    /// Whether it overlaps another one, exactly.
    fn meets(&self, other: &Self) -> bool;

    /// How many are sampled at the most where that decides.
    const SAMPLED: usize;
}

impl Body for Aabb {
    fn inner(&self) -> Aabb {
        *self
    }

    #[inline(always)]
    fn holds(&self, point: [f32; 3]) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }

    #[inline(always)]
    fn meets(&self, other: &Self) -> bool {
        let apart =
            |axis: usize| self.min[axis] > other.max[axis] || other.min[axis] > self.max[axis];
        !(0..3).any(apart)
    }

    const SAMPLED: usize = MANY_SAMPLED;
}

/// What is seen of the pairs of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outlook {
    /// There are so many or more.
    AtLeast(u64),
    /// So many are expected, and nothing is sure.
    Expected(f64),
}

/// Pairs of objects, which `get` reads, or of one of the `first` and one of the others: more than `beyond` where that is
/// sure, which is looked for where a sample says so.
pub(crate) fn outlook<T: Body>(
    (n, first): (usize, Option<usize>),
    get: impl Fn(usize) -> Option<T>,
    beyond: u64,
    cancel: &Cancel,
) -> Outlook {
    floats::with_default(|| {
        let sample: Vec<Aabb> = sample_indices(SAMPLED.min(n), n)
            .filter_map(|index| get(index).map(|this| this.inner()).filter(holds_points))
            .collect();
        let met: usize = (1..sample.len())
            .map(|i| sample[..i].iter().filter(|b| b.overlaps(&sample[i])).count())
            .sum();
        if (met as u64) < SAMPLED_PAIRS {
            return Outlook::Expected(0.0);
        }
        let sampled = SAMPLED as f64 * (SAMPLED - 1) as f64 / 2.0;
        let of_all =
            first.map_or(n as f64 * n as f64 / 2.0, |first| first as f64 * (n - first) as f64);
        let expected = met as f64 / sampled * of_all;
        if expected * EXPECTED_SHARE < beyond as f64 {
            return Outlook::Expected(expected);
        }
        let lattice = [0, 1, 2].map(|axis| coordinates(&sample, axis));
        match count((n, first), &get, &lattice, beyond, cancel) {
            pairs if pairs > beyond => Outlook::AtLeast(pairs),
            _ if are_surely_more((n, first), &get, beyond as f64 / of_all, cancel) => {
                Outlook::AtLeast(beyond + 1)
            }
            _ => Outlook::Expected(expected),
        }
    })
}

/// Whether more than this share of all pairs overlap, as a large sample shows.
fn are_surely_more<T: Body>(
    (n, first): (usize, Option<usize>),
    get: &impl Fn(usize) -> Option<T>,
    share: f64,
    cancel: &Cancel,
) -> bool {
    let most = T::SAMPLED.min((2 * SAMPLED_PAIRS_A_BOX * n).isqrt());
    let sampled = |from: usize, n: usize| -> Vec<T> {
        let indices = sample_indices(most.min(n), n);
        indices
            .filter_map(|index| get(from + index))
            .filter(|this| holds_points(&this.inner()))
            .collect()
    };
    let (all, others) = match first {
        None => (sampled(0, n), Vec::new()),
        Some(first) => (sampled(0, first), sampled(first, n - first)),
    };
    let mut met = 0u64;
    for (i, one) in all.iter().enumerate() {
        if i % 64 == 0 && cancel.look() {
            return false;
        }
        let others = if first.is_none() { &all[..i] } else { &others };
        met += others.iter().map(|other| u64::from(one.meets(other))).sum::<u64>();
    }
    // Of as many pairs as were drawn, those of boxes without a point too. Half of the boxes are pairs of their own.
    let count = |n: usize| n.min(most) as f64;
    let (drawn, apart) = if let Some(first) = first {
        let [a, b] = [first, n - first].map(count);
        (a * b, a.min(b))
    } else {
        let all = count(n);
        (all * (all - 1.0) / 2.0, (all / 2.0).floor())
    };
    exceeds(met as f64 / drawn, share, apart)
}

/// Whether a mean of so many independent draws at the least shows that a share is larger, by far more than by chance.
fn exceeds(mean: f64, share: f64, draws: f64) -> bool {
    if mean <= share || share <= 0.0 {
        return false;
    }
    let part = |p: f64, q: f64| if p > 0.0 { p * (p / q).ln() } else { 0.0 };
    draws * (part(mean, share) + part(1.0 - mean, 1.0 - share)) > NO_CHANCE
}

fn holds_points(b: &Aabb) -> bool {
    (0..3).all(|axis| b.min[axis] <= b.max[axis])
}

/// Coordinates on an axis that rise, of which most boxes hold one: the last of the box that ends first, then of those that
/// do not hold it. Where these are too many, those that most boxes hold.
fn coordinates(sample: &[Aabb], axis: usize) -> Vec<f32> {
    let mut spans: Vec<[f32; 2]> = sample.iter().map(|b| [b.min[axis], b.max[axis]]).collect();
    spans.sort_unstable_by(|a, b| a[1].total_cmp(&b[1]));
    let mut chosen: Vec<(usize, f32)> = Vec::new();
    while let Some([_, at]) = spans.first().copied() {
        let before = spans.len();
        spans.retain(|[min, _]| *min > at);
        chosen.push((before - spans.len(), at));
    }
    chosen.sort_by_key(|(held_by, _)| std::cmp::Reverse(*held_by));
    chosen.truncate(COORDINATES);
    let mut coordinates: Vec<f32> = chosen.into_iter().map(|(_, at)| at).collect();
    coordinates.sort_unstable_by(f32::total_cmp);
    coordinates
}

/// Pairs of objects that hold the same point of a lattice, until there are more than `beyond`.
fn count<T: Body>(
    (n, first): (usize, Option<usize>),
    get: impl Fn(usize) -> Option<T>,
    lattice: &[Vec<f32>; 3],
    beyond: u64,
    cancel: &Cancel,
) -> u64 {
    // Of each point those of the first set, and the others.
    let mut counts = vec![[0u32; 2]; COORDINATES.pow(3)];
    let mut pairs = 0u64;
    for start in (0..n).step_by(COUNTED_AT_ONCE) {
        if pairs > beyond || cancel.look() {
            break;
        }
        for index in start..n.min(start + COUNTED_AT_ONCE) {
            // Copied once: a client could write to it meanwhile.
            let Some(this) = get(index) else { continue };
            let inner = this.inner();
            let slots = [0, 1, 2].map(|axis: usize| {
                lattice[axis].iter().map(|at| usize::from(*at < inner.min[axis])).sum::<usize>()
            });
            let [Some(&x), Some(&y), Some(&z)] =
                [0, 1, 2].map(|axis: usize| lattice[axis].get(slots[axis]))
            else {
                continue;
            };
            if this.holds([x, y, z]) {
                let slot = slots.into_iter().fold(0, |slot, at| slot * COORDINATES + at);
                let is_other = usize::from(first.is_some_and(|first| index >= first));
                let met = if first.is_some() { 1 - is_other } else { 0 };
                pairs += u64::from(counts[slot][met]);
                counts[slot][is_other] += 1;
            }
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::oracle;
    use crate::sphere::Sphere;

    fn of(boxes: &[Aabb], first: Option<usize>, beyond: u64) -> Outlook {
        outlook((boxes.len(), first), |i| boxes.get(i).copied(), beyond, &Cancel::never())
    }

    #[test]
    fn crowds_are_counted() {
        let n = 10_000;
        let all = n as u64 * (n as u64 - 1) / 2;
        let unit = Aabb::new([0.0; 3], [1.0; 3]);
        let infinite = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
        for same in [unit, infinite, Aabb::point([-0.0; 3])] {
            let boxes = vec![same; n];
            assert!(matches!(of(&boxes, None, all - 1), Outlook::AtLeast(pairs) if pairs == all));
            assert!(
                matches!(of(&boxes, None, all), Outlook::Expected(_)),
                "no more than there are"
            );
            let beyond = 100 * 9_900 - 1;
            assert!(matches!(of(&boxes, Some(100), beyond), Outlook::AtLeast(_)));
            assert!(matches!(of(&boxes, Some(100), beyond + 1), Outlook::Expected(_)));
        }
        let nothing = vec![Aabb::EMPTY; n];
        assert_eq!(of(&nothing, None, 0), Outlook::Expected(0.0));
    }

    #[test]
    fn a_heap_without_crowds_is_sampled() {
        // Plates, rods and their like of three directions: each meets most others, and no point is in many.
        let mut random = crate::random::Random(11);
        let mut at = || random.below(1 << 20) as f32;
        let boxes: Vec<Aabb> = (0..30_000)
            .map(|i| {
                let (mut min, mut max) = ([0.0; 3], [1e6; 3]);
                min[i % 3] = at();
                max[i % 3] = min[i % 3];
                Aabb::new(min, max)
            })
            .collect();
        let pairs = 3 * 10_000u64 * 10_000;
        assert!(matches!(of(&boxes, None, pairs / 3), Outlook::AtLeast(_)));
        assert!(matches!(of(&boxes, None, pairs * 21 / 20), Outlook::Expected(_)));
        assert!(matches!(of(&boxes, Some(15_000), pairs / 6), Outlook::AtLeast(_)));
    }

    #[test]
    fn chance_decides_nothing() {
        assert!(exceeds(0.06, 0.006, 1_024.0) && !exceeds(0.06, 0.05, 1_024.0));
        assert!(!exceeds(0.06, 0.06, 1e12) && !exceeds(0.05, 0.06, 1e12));
        assert!(exceeds(1.0, 0.5, 100.0) && !exceeds(1.0, 0.5, 10.0));
    }

    #[test]
    fn a_pile_is_a_few_crowds() {
        let mut random = crate::random::Random(7);
        let mut unit = || random.below(1 << 20) as f32 / (1 << 20) as f32;
        let boxes: Vec<Aabb> = (0..20_000)
            .map(|_| {
                let min = [(); 3].map(|()| 5.0 * unit());
                Aabb::new(min, min.map(|x| x + 1.0))
            })
            .collect();
        let pairs = oracle::truth(&boxes).pairs.len() as u64;
        let Outlook::AtLeast(found) = of(&boxes, None, pairs / 20) else { panic!("{pairs}") };
        assert!(found <= pairs);
    }

    proptest! {
        #[test]
        fn no_more_pairs_are_sure_than_there_are(
            corners in prop::collection::vec(prop::array::uniform6(-3i8..3), 2..150),
            first in 0usize..150,
        ) {
            let boxes: Vec<Aabb> = corners
                .into_iter()
                .map(|c| {
                    let [a, b, c, d, e, f] = c.map(|x| if x == 2 { f32::NAN } else { f32::from(x) });
                    Aabb { min: [a, b, c], max: [d, e, f] }
                })
                .collect();
            let first = first.min(boxes.len());
            for first in [None, Some(first)] {
                let pairs = (0..boxes.len())
                    .flat_map(|b| (0..b).map(move |a| (a, b)))
                    .filter(|(a, b)| first.is_none_or(|first| *a < first && first <= *b))
                    .filter(|(a, b)| boxes[*a].overlaps(&boxes[*b]))
                    .count() as u64;
                prop_assert!(!matches!(of(&boxes, first, pairs), Outlook::AtLeast(_)));
                if let Outlook::AtLeast(found) = of(&boxes, first, 0) {
                    prop_assert!(found <= pairs);
                }
            }
        }

        #[test]
        fn spheres_that_hold_a_point_overlap(
            spheres in prop::collection::vec(prop::array::uniform4(-2f32..2.0), 2..100),
        ) {
            let spheres: Vec<Sphere> = spheres.into_iter().map(Sphere::from).collect();
            let pairs = (0..spheres.len())
                .flat_map(|b| (0..b).map(move |a| (a, b)))
                .filter(|(a, b)| spheres[*a].overlaps(&spheres[*b]))
                .count() as u64;
            let get = |i: usize| spheres.get(i).copied();
            let found = outlook((spheres.len(), None), get, 0, &Cancel::never());
            prop_assert!(!matches!(found, Outlook::AtLeast(found) if found > pairs));
        }
    }
}
