//! A case in a precision mode: the boxes that a client would send, and the allowed answers to them.

use std::fmt;
use std::str::FromStr;

use pairmask_core::engine::UnknownName;
use pairmask_core::oracle::Faces;
use pairmask_core::oracle::modes::{Allowed, allowed, allowed_around_origin, allowed_by_margin};
use pairmask_core::precision::Margin;
use pairmask_core::{Aabb, Bounds, Precision};
use pairmaskd::precision::as_sent;
use pairmaskd::scene::Random;
use serde::{Deserialize, Serialize};

use super::case::MOST_PAIRS;
use super::flags::MixedFlags;

/// Most boxes of a mode's scene: each mode has a truth of its own, by two loops, and conversions
/// work in groups of eight.
const MOST_BOXES: usize = 1_100;

/// Makes the random numbers of modes independent of those of boxes.
const STREAM: u64 = 0x4d4f_4445_5300;

/// A precision mode as `--mode` names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// f32 as it is.
    Exact,
    /// 16-bit cells.
    Q16,
    /// 8-bit cells.
    Q8,
    /// Halves.
    F16,
    /// Boxes inflated by a margin.
    Margin,
    /// f64 boxes against an origin.
    F64,
}

impl Mode {
    /// Every mode.
    pub const ALL: [Self; 6] =
        [Self::Exact, Self::Q16, Self::Q8, Self::F16, Self::Margin, Self::F64];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Q16 => "q16",
            Self::Q8 => "q8",
            Self::F16 => "f16",
            Self::Margin => "margin",
            Self::F64 => "f64",
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// A value of `--mode`: one mode, or all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeChoice {
    /// Every mode.
    All,
    /// One mode.
    Only(Mode),
}

impl ModeChoice {
    /// Whether it includes a mode.
    pub fn has(self, mode: Mode) -> bool {
        self == Self::All || self == Self::Only(mode)
    }
}

impl FromStr for ModeChoice {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        let mode = || Mode::ALL.into_iter().find(|mode| mode.as_str() == s).map(Self::Only);
        let known = "all, exact, q16, q8, f16, margin, f64".into();
        let all = (s == "all").then_some(Self::All);
        all.or_else(mode).ok_or_else(|| UnknownName { name: s.to_owned(), known })
    }
}

impl fmt::Display for ModeChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Only(mode) => mode.fmt(f),
        }
    }
}

/// One way to use a mode other than exact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Usage {
    /// Cells of the bounds of the boxes.
    Q16,
    /// Cells of bounds that many boxes lie outside of.
    Q16SmallBounds,
    /// As [`Usage::Q16`].
    Q8,
    /// As [`Usage::Q16SmallBounds`].
    Q8SmallBounds,
    /// Halves.
    F16,
    /// A margin of the order of a box of the case, or none.
    Margin,
    /// A world in f64 whose f32 boxes lie far from 0, relative to an origin among them.
    F64,
}

impl Usage {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Q16,
        Self::Q16SmallBounds,
        Self::Q8,
        Self::Q8SmallBounds,
        Self::F16,
        Self::Margin,
        Self::F64,
    ];

    /// The mode.
    pub const fn mode(self) -> Mode {
        match self {
            Self::Q16 | Self::Q16SmallBounds => Mode::Q16,
            Self::Q8 | Self::Q8SmallBounds => Mode::Q8,
            Self::F16 => Mode::F16,
            Self::Margin => Mode::Margin,
            Self::F64 => Mode::F64,
        }
    }
}

impl fmt::Display for Usage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let small = matches!(self, Self::Q16SmallBounds | Self::Q8SmallBounds);
        write!(f, "{}{}", self.mode(), if small { " in small bounds" } else { "" })
    }
}

/// The way in which boxes were sent, with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Sending {
    /// Narrow forms.
    Narrow(Precision),
    /// Inflated boxes.
    Inflated(Margin),
    /// Boxes of a world.
    World {
        /// The boxes.
        boxes: Vec<Faces>,
        /// The origin that the sent boxes are relative to.
        origin: [f64; 3],
    },
}

/// A case in one usage of a mode.
#[derive(Clone, Debug)]
pub struct ModeCase {
    /// The given boxes: the first ones of the case. For a world, the f32 boxes that it was made
    /// from.
    pub given: Vec<Aabb>,
    /// How they were sent.
    pub sending: Sending,
    /// The boxes that engines get.
    pub sent: Vec<Aabb>,
    /// The first box that is converted differently when each box is written by itself, on threads of
    /// different floating-point flags.
    pub written_unlike: Option<usize>,
    /// The allowed answers.
    pub allowed: Allowed,
}

impl ModeCase {
    /// The boxes of a case in one usage.
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
        // All boxes in one call, and each by itself: the result must not depend on the writing
        // thread.
        let n = given.len();
        let (sent, alone, allowed) = match &sending {
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
        let sent: Vec<Aabb> = sent;
        let bits = |b: &Aabb| <[f32; 6]>::from(*b).map(f32::to_bits);
        let written_unlike = sent.iter().zip(&alone).position(|(a, b)| bits(a) != bits(b));
        Self { given: given.to_vec(), sending, sent, written_unlike, allowed }
    }
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

/// The boxes in f64, moved away by up to 2^40 times the scene's extent, some faces by one step of f64
/// more, and an origin near the middle of them.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::Case;

    fn cases() -> impl Iterator<Item = Case> {
        let mut run = Random::new(7);
        std::iter::repeat_with(move || Case::new(Case::next_seed(&mut run))).take(60)
    }

    #[test]
    fn every_mode_has_pairs_beyond_the_overlapping_ones_and_never_fewer() {
        for usage in Usage::ALL {
            let mut extra = 0;
            for case in cases() {
                let Allowed { must, may } = case.in_mode(usage).allowed.clone();
                let is_part = must.pairs.iter().all(|pair| may.binary_search(pair).is_ok());
                assert!(is_part, "{usage}, case {}", case.seed);
                assert!(may.len() <= MOST_PAIRS);
                extra += may.len() - must.pairs.len();
            }
            assert!(extra > 20, "{usage}: {extra} pairs may be extra");
        }
    }

    #[test]
    fn small_bounds_leave_boxes_outside() {
        let outside = |case: &Case| {
            let mode = case.in_mode(Usage::Q8SmallBounds);
            let Sending::Narrow(Precision::Q8(bounds)) = &mode.sending else {
                panic!("cells have bounds")
            };
            mode.given.iter().any(|b| b.min[0] > bounds.high()[0] || b.max[0] < bounds.low()[0])
        };
        assert!(cases().filter(outside).count() > 20);
    }

    #[test]
    fn names_parse_back() {
        for mode in Mode::ALL {
            assert_eq!(mode.as_str().parse(), Ok(ModeChoice::Only(mode)));
            assert!(ModeChoice::All.has(mode));
        }
        assert_eq!("all".parse(), Ok(ModeChoice::All));
        assert!("q17".parse::<ModeChoice>().is_err());
    }
}
