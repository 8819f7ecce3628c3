//! A case in a precision mode: the boxes that are sent, the allowed answers, and the gaps of extra pairs.

use std::fmt;

use pairmask_core::oracle::modes::{Allowed, allowed, allowed_around_origin, allowed_by_margin};
use pairmask_core::oracle::{Faces, Pair};
use pairmask_core::precision::{Margin, Widening};
use pairmask_core::{Aabb, Bounds, Precision};
use pairmaskd::explain::SentBoxes;
use pairmaskd::precision::as_sent;
use pairmaskd::scene::Random;
use pairmaskd::shown::Shown;
use serde::{Deserialize, Serialize};

use super::answer::{Finding, absent};
use super::case::MOST_PAIRS;
use super::flags::MixedFlags;

/// Most boxes of a mode's scene: each mode has a truth of its own, by two loops.
const MOST_BOXES: usize = 1_100;

/// Makes the random numbers of modes independent of those of boxes.
const STREAM: u64 = 0x4d4f_4445_5300;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Usage {
    Q16,
    /// Cells of bounds that many boxes lie outside of.
    Q16SmallBounds,
    Q8,
    Q8SmallBounds,
    F16,
    /// A margin of the order of a box of the case, or none.
    Margin,
    /// A world in f64 whose f32 boxes lie far from 0, relative to an origin among them.
    F64,
}

impl Usage {
    pub const ALL: [Self; 7] = [
        Self::Q16,
        Self::Q16SmallBounds,
        Self::Q8,
        Self::Q8SmallBounds,
        Self::F16,
        Self::Margin,
        Self::F64,
    ];

    pub const fn mode(self) -> &'static str {
        match self {
            Self::Q16 | Self::Q16SmallBounds => "q16",
            Self::Q8 | Self::Q8SmallBounds => "q8",
            Self::F16 => "f16",
            Self::Margin => "margin",
            Self::F64 => "f64",
        }
    }
}

impl fmt::Display for Usage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let small = matches!(self, Self::Q16SmallBounds | Self::Q8SmallBounds);
        write!(f, "{}{}", self.mode(), if small { " in small bounds" } else { "" })
    }
}

#[derive(Clone, Debug, PartialEq)]
pub enum Sending {
    Narrow(Precision),
    Inflated(Margin),
    World {
        boxes: Vec<Faces>,
        /// The origin that the sent boxes are relative to.
        origin: [f64; 3],
    },
}

#[derive(Clone, Debug)]
pub struct ModeCase {
    /// The first boxes of the case; for a world, the f32 boxes that it was made from.
    pub given: Vec<Aabb>,
    pub sending: Sending,
    pub sent: Vec<Aabb>,
    /// The first box that becomes another one when each is written by itself, on threads of all flags.
    pub written_unlike: Option<usize>,
    pub allowed: Allowed,
}

impl ModeCase {
    pub fn new(seed: u64, boxes: &[Aabb], usage: Usage, flags: &MixedFlags) -> Self {
        let mut given = &boxes[..boxes.len().min(MOST_BOXES)];
        loop {
            let case = Self::of_boxes(seed, given, usage, flags);
            if case.allowed.may.len() <= MOST_PAIRS {
                return case;
            }
            given = &given[..given.len() / 2];
        }
    }

    fn of_boxes(seed: u64, given: &[Aabb], usage: Usage, flags: &MixedFlags) -> Self {
        let random = &mut Random::new(seed ^ STREAM);
        let sending = match usage {
            Usage::Q16 => Sending::Narrow(Precision::Q16(Bounds::around(given))),
            Usage::Q8 => Sending::Narrow(Precision::Q8(Bounds::around(given))),
            Usage::Q16SmallBounds => Sending::Narrow(Precision::Q16(small_bounds(given, random))),
            Usage::Q8SmallBounds => Sending::Narrow(Precision::Q8(small_bounds(given, random))),
            Usage::F16 => Sending::Narrow(Precision::F16),
            Usage::Margin => Sending::Inflated(margin(given, random)),
            Usage::F64 => {
                let (boxes, origin) = world(given, random);
                Sending::World { boxes, origin }
            }
        };
        // All boxes in one call, and each by itself: the result must not depend on the writing thread.
        let n = given.len();
        let (sent, alone, allowed): (Vec<Aabb>, _, _) = match &sending {
            Sending::Narrow(precision) => (
                flags.caller.run(|| as_sent(precision, given)),
                flags.written(n, |i| as_sent(precision, &given[i..=i])[0]),
                flags.caller.run(|| allowed(given, precision)),
            ),
            Sending::Inflated(margin) => (
                given.iter().map(|b| margin.inflate(b)).collect(),
                flags.written(n, |i| margin.inflate(&given[i])),
                flags.caller.run(|| allowed_by_margin(given, margin.get())),
            ),
            Sending::World { boxes, origin } => {
                let relative = |[min, max]: &Faces| Aabb::outward_from_f64(*min, *max, *origin);
                (
                    boxes.iter().map(relative).collect(),
                    flags.written(n, |i| relative(&boxes[i])),
                    flags.caller.run(|| allowed_around_origin(boxes, *origin)),
                )
            }
        };
        let written_unlike = first_unlike(&sent, &alone);
        Self { given: given.to_vec(), sending, sent, written_unlike, allowed }
    }

    /// Why a pair must be in the answer or not. It begins with f32 boxes: for a world, with those sent.
    pub(super) fn explain(&self, i: u32, j: u32) -> Option<Shown> {
        let (given, sent) = match &self.sending {
            Sending::Narrow(precision) => (&self.given, SentBoxes::narrow(precision, &self.sent)),
            Sending::Inflated(margin) => (&self.given, SentBoxes::inflated(*margin, &self.sent)),
            Sending::World { .. } => (&self.sent, SentBoxes::relative(&self.sent)),
        };
        pairmaskd::explain::explain(given, &sent, i, j).ok()
    }

    fn faces(&self, index: u32) -> Faces {
        if let Sending::World { boxes, .. } = &self.sending {
            return boxes[index as usize];
        }
        let b = &self.given[index as usize];
        [b.min.map(f64::from), b.max.map(f64::from)]
    }
}

fn first_unlike(these: &[Aabb], those: &[Aabb]) -> Option<usize> {
    let bits = |b: &Aabb| <[f32; 6]>::from(*b).map(f32::to_bits);
    these.iter().zip(those).position(|(a, b)| bits(a) != bits(b))
}

/// Bounds between faces of the boxes, so that boxes lie within, outside, across and on them.
fn small_bounds(boxes: &[Aabb], random: &mut Random) -> Bounds {
    let around = Bounds::around(boxes);
    let mut face = |axis: usize| {
        let b = boxes.get(random.below(boxes.len().max(1) as u64) as usize)?;
        let x = if random.below(2) == 0 { b.min[axis] } else { b.max[axis] };
        x.is_finite().then_some(x)
    };
    let (mut low, mut high) = (around.low(), around.high());
    for axis in 0..3 {
        let (a, b) = (face(axis).unwrap_or(low[axis]), face(axis).unwrap_or(high[axis]));
        (low[axis], high[axis]) = (a.min(b), a.max(b));
    }
    // Faces that are no numbers are no bounds: then the bounds are those of the whole scene.
    Bounds::new(low, high).unwrap_or(around)
}

/// 0, or an edge of a box times a power of two.
fn margin(boxes: &[Aabb], random: &mut Random) -> Margin {
    let scale = [0.0, 1.0 / 1024.0, 0.25, 1.0, 8.0][random.below(5) as usize];
    let axis = random.below(3) as usize;
    let edge = boxes
        .get(random.below(boxes.len().max(1) as u64) as usize)
        .map_or(1.0, |b| (b.max[axis] - b.min[axis]).abs());
    Margin::new(edge * scale).unwrap_or_default()
}

/// The boxes in f64, up to 2^40 extents away, some faces one step of f64 more, and an origin among them.
fn world(boxes: &[Aabb], random: &mut Random) -> (Vec<Faces>, [f64; 3]) {
    let around = Bounds::around(boxes);
    let (low, high) = (around.low().map(f64::from), around.high().map(f64::from));
    let offset: [f64; 3] = std::array::from_fn(|axis| {
        let extent = low[axis].abs().max(high[axis].abs());
        let far = extent * (1u64 << random.below(41)) as f64;
        [far, -far, 0.0][random.below(3) as usize]
    });
    let moved = |x: f32, axis: usize, random: &mut Random| {
        let x = f64::from(x) + offset[axis];
        [x, x, x.next_down(), x.next_up()][random.below(4) as usize]
    };
    let faces = boxes
        .iter()
        .map(|b| {
            [b.min, b.max].map(|side| std::array::from_fn(|axis| moved(side[axis], axis, random)))
        })
        .collect();
    let share = f64::from(random.unit());
    let origin = std::array::from_fn(|axis| {
        let inside = share.mul_add(high[axis] - low[axis], low[axis]);
        offset[axis] + if random.below(2) == 0 { 0.0 } else { inside }
    });
    (faces, origin)
}

/// Compares the gaps of extra pairs of an answer with the one that the mode states, without rounding.
pub(super) fn check_gaps(case: &ModeCase, got: &[Pair]) -> Result<(), Finding> {
    let far = too_far(case, got, 1.0);
    let Some(&(pair, axis, gap, stated)) = far.first() else { return Ok(()) };
    let what = format!(
        "pair {pair:?} has a gap of {gap:e} on axis {axis}, and the mode states {stated:e} at most"
    );
    Err(Finding::extra(what, far.len() as u64, pair))
}

/// The extra pairs that are farther apart than a share of what is stated, each with the first axis on which
/// it is, the gap there, and what is stated.
fn too_far(case: &ModeCase, got: &[Pair], share: f64) -> Vec<(Pair, usize, f64, f64)> {
    let far = |pair: Pair| {
        let (a, b) = (case.faces(pair[0]), case.faces(pair[1]));
        (0..3).find_map(|axis| {
            let ends = a[1][axis].min(b[1][axis]);
            let starts = a[0][axis].max(b[0][axis]);
            if starts <= ends {
                return None;
            }
            // The largest gap on an axis, given where one box ends and the other starts.
            let stated = share
                * match &case.sending {
                    Sending::Narrow(precision) => {
                        precision.widening().gap_limit(axis, ends, starts)
                    }
                    Sending::Inflated(margin) => {
                        margin.gap_limit(&Widening::None, axis, ends, starts)
                    }
                    Sending::World { origin, .. } => {
                        Widening::Origin(*origin).gap_limit(axis, ends, starts)
                    }
                };
            let is_within = difference_is_at_most(starts, ends, stated);
            (!is_within).then_some((pair, axis, starts - ends, stated))
        })
    };
    absent(got, &case.allowed.must.pairs).filter_map(far).collect()
}

/// Whether x − y ≤ `limit` in the arithmetic of real numbers. False where one of them is a NaN.
fn difference_is_at_most(x: f64, y: f64, limit: f64) -> bool {
    if limit == f64::INFINITY {
        return true;
    }
    let difference = x - y;
    if difference != limit || difference.is_infinite() {
        return difference < limit;
    }
    // What rounding took off x + (−y) (two-sum, Knuth).
    let virtual_y = difference - x;
    (x - (difference - virtual_y)) + (-y - virtual_y) <= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::Case;

    fn cases(count: usize) -> impl Iterator<Item = Case> {
        let mut run = Random::new(7);
        std::iter::repeat_with(move || Case::new(Case::next_seed(&mut run))).take(count)
    }

    /// Of each usage: answers are possible, extra pairs too, and a stated gap of half the size is noticed.
    #[test]
    fn every_mode_has_extra_pairs_whose_gaps_are_as_stated() {
        for usage in Usage::ALL {
            let (mut extra, mut outside, mut found) = (0, 0, 0);
            for case in cases(150) {
                let case = case.in_mode(usage);
                let Allowed { must, may } = &case.allowed;
                let is_part = must.pairs.iter().all(|pair| may.binary_search(pair).is_ok());
                assert!(is_part && may.len() <= MOST_PAIRS, "{usage}");
                // An engine's answer: the pairs of the boxes that were sent.
                let got = pairmask_core::oracle::truth(&case.sent).pairs;
                assert_eq!(check_gaps(case, &got), Ok(()), "{usage}");
                extra += may.len() - must.pairs.len();
                found += too_far(case, &got, 0.5).len();
                if let Sending::Narrow(Precision::Q8(bounds)) = &case.sending {
                    let (low, high) = (bounds.low()[0], bounds.high()[0]);
                    outside +=
                        case.given.iter().filter(|b| b.min[0] > high || b.max[0] < low).count();
                }
            }
            assert!(extra > 50 && found > 0, "{usage}: {extra} may be extra, {found} found");
            assert!(outside > 20 || usage != Usage::Q8SmallBounds, "{outside} boxes are outside");
        }
    }

    #[test]
    fn differences_are_compared_without_rounding() {
        assert!(difference_is_at_most(3.0, 1.0, 2.0) && !difference_is_at_most(3.0, 1.0, 1.9));
        // 1 + 2⁻⁶⁰ rounds to 1.
        let tiny = 2.0f64.powi(-60);
        assert!(!difference_is_at_most(1.0, -tiny, 1.0) && difference_is_at_most(1.0, tiny, 1.0));
        assert!(difference_is_at_most(f64::INFINITY, 0.0, f64::INFINITY));
        assert!(!difference_is_at_most(f64::INFINITY, 0.0, f64::MAX));
        assert!(!difference_is_at_most(f64::NAN, 0.0, 1.0));
    }
}
