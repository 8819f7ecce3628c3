//! Margins: an answer that stays good while nothing has moved far.
//!
//! Boxes are inflated by a margin when they are sent. As long as every box lies within its inflated
//! self, every pair that overlaps now is a pair of the last answer: two boxes that share a point
//! share it inside their inflated selves. So the last mask is kept and no request is made.
//!
//! That a box lies within its inflated self is decided by comparing integer keys, so rounding has
//! no part in the proof. Rounding decides only how long an answer is kept: inflated faces are
//! rounded outward, so a box whose faces moved by no more than the margin is always within. They are
//! computed with the default floating-point flags, since a box has to lie within its own inflated self:
//! a thread that takes subnormals for zero would not see to that.

use rayon::prelude::*;

use super::Session;
use super::error::{FrameError, WaitError};
use super::pairs::PairMask;
use pairmask_core::aabb::{Aabb, BoxClass, KeyBox, order_key};
use pairmask_core::floats;
use pairmask_core::precision::{Precision, Widening, outward, step_of_f32};

/// Boxes that one task looks at: fewer take less time than a task costs.
const TASK_BOXES: usize = 16_384;

/// How far boxes may move before they are sent again, units; finite and not negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Margin(f32);

/// Why a number is no margin.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("a margin of {given}: give a finite number that is not negative")]
pub struct MarginError {
    /// What was given.
    pub given: f32,
}

impl Margin {
    /// A margin of so many units.
    ///
    /// # Errors
    /// [`MarginError`] where it is negative, infinite or NaN.
    pub fn new(units: f32) -> Result<Self, MarginError> {
        // A comparison of floats would take a subnormal below 0 for 0 on some threads.
        let is_margin = units.is_finite() && order_key(units.to_bits()) >= 0;
        if is_margin { Ok(Self(units)) } else { Err(MarginError { given: units }) }
    }

    /// The number itself.
    pub const fn get(self) -> f32 {
        self.0
    }

    /// A box whose faces lie outward by the margin and up to two steps of f32 more. Empty and
    /// invalid boxes stay as they are.
    ///
    /// The inflated box is the same whatever the floating-point flags of this thread.
    pub fn inflate(self, b: &Aabb) -> Aabb {
        floats::with_default(|| self.inflate_with_default_flags(b))
    }

    /// Boxes inflated, as many as both slices hold; with the default flags.
    fn inflate_all(self, boxes: &[Aabb], out: &mut [Aabb]) {
        floats::with_default(|| {
            for (b, out) in boxes.iter().zip(out) {
                *out = self.inflate_with_default_flags(b);
            }
        });
    }

    #[inline]
    fn inflate_with_default_flags(self, b: &Aabb) -> Aabb {
        debug_assert!(floats::are_default(), "boxes are inflated with the default flags");
        if b.class() != BoxClass::Solid {
            return *b;
        }
        // The rounded difference is within half a step of the exact one: a step is enough.
        Aabb {
            min: b.min.map(|x| (x - self.0).next_down()),
            max: b.max.map(|x| (x + self.0).next_up()),
        }
    }

    /// How far outward a face at `x` comes to lie at most: the margin and two steps of f32 there. Those
    /// outweigh a small margin far from 0: at 10^6 units two steps are a quarter of a unit.
    fn reach(self, x: f64) -> f64 {
        let margin = f64::from(self.0);
        2.0f64.mul_add(step_of_f32(x.abs() + margin), margin)
    }

    /// The largest gap that two boxes may have and still be a pair of the answer that was asked for
    /// with them: on an axis on which one ends at `ends` and the other starts at `starts`, their boxes
    /// being sent in a form that widens them by `form`. It is twice the margin, the steps of f32 that
    /// inflated faces are rounded by, and what the form adds; infinite where a face is.
    ///
    /// While the answer is kept, boxes may move apart, each face by as much again; a box that shrinks
    /// stays in the answer however small it becomes. [`Kept::exact_pairs`] goes by the boxes of now.
    ///
    /// ```
    /// use pairmask::precision::Widening;
    /// use pairmask::session::Margin;
    /// let margin = Margin::new(0.001)?;
    /// let gap_at = |x| margin.gap_limit(&Widening::None, 0, x, x);
    /// assert!(gap_at(1.0) < 0.00201);
    /// assert!(gap_at(1e6) > 0.25, "f32 has steps of a sixteenth there");
    /// # Ok::<(), pairmask::session::MarginError>(())
    /// ```
    ///
    /// # Panics
    /// When there is no such axis.
    pub fn gap_limit(self, form: &Widening, axis: usize, ends: f64, starts: f64) -> f64 {
        floats::with_default(|| {
            if ends.is_infinite() || starts.is_infinite() {
                return f64::INFINITY;
            }
            let (end_reach, start_reach) = (self.reach(ends), self.reach(starts));
            let form_gap =
                form.gap_between(axis, [ends, ends + end_reach], [starts, starts - start_reach]);
            outward(end_reach + start_reach + form_gap)
        })
    }
}

/// What margins have spared so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MarginStats {
    /// Frames that were asked for.
    pub requests: u64,
    /// Frames that the last answer was good for.
    pub skipped: u64,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum MarginedError {
    /// The frame could not be sent.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The frame was not answered.
    #[error(transparent)]
    Wait(#[from] WaitError),
}

/// A session that asks only when something has moved by more than a margin.
///
/// A mask is a superset of the overlapping pairs: those, and boxes whose gap was at most
/// [`Margin::gap_limit`] when they were sent: twice the margin, steps of f32 and what the precision
/// adds. [`Kept::exact_pairs`] sorts them out by the boxes of now.
///
/// The kept mask is one of the three frames that a session has at a time.
///
/// ```
/// use pairmask::session::{Margin, Margined};
/// use pairmask::{Aabb, Backend, Session};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let session = Session::builder().backend(Backend::InProcess).connect()?;
/// let mut margined = Margined::new(session, Margin::new(0.5)?);
/// let mut boxes =
///     [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), Aabb::from([1.25, 0.0, 0.0, 2.0, 1.0, 1.0])];
/// for step in 0..3 {
///     let kept = margined.cull(&boxes)?;
///     assert!(kept.mask().contains(0, 1), "near enough to be kept in mind");
///     assert_eq!(kept.exact_pairs().count(), usize::from(step > 0));
///     boxes[1].min[0] -= 0.25;
/// }
/// assert_eq!((margined.stats().requests, margined.stats().skipped), (1, 2));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Margined {
    session: Session,
    margin: Margin,
    precision: Precision,
    inflated: Vec<Aabb>,
    answered: Option<Answered>,
    /// Memory of an answer that was given up.
    spare_keys: Vec<KeyBox>,
    stats: MarginStats,
}

/// The last answer, and the inflated boxes that it is the answer to.
#[derive(Debug)]
struct Answered {
    mask: PairMask,
    keys: Vec<KeyBox>,
}

impl Answered {
    /// Whether every box lies within its inflated self. A box that has become empty or invalid
    /// lies within anything; one that was, and is solid now, within nothing: the keys of
    /// [`KeyBox::NOTHING`] say so by themselves.
    fn covers(&self, boxes: &[Aabb]) -> bool {
        let within = |(old, b): (&KeyBox, &Aabb)| {
            let now = KeyBox::from(b);
            (0..3).all(|axis| old.min[axis] <= now.min[axis] && now.max[axis] <= old.max[axis])
        };
        let all_within = |(old, boxes): (&[KeyBox], &[Aabb])| old.iter().zip(boxes).all(within);
        self.keys.len() == boxes.len()
            && if boxes.len() < 2 * TASK_BOXES {
                all_within((&self.keys, boxes))
            } else {
                let tasks = self.keys.par_chunks(TASK_BOXES).zip(boxes.par_chunks(TASK_BOXES));
                tasks.all(all_within)
            }
    }
}

impl Margined {
    /// A session with a margin.
    pub fn new(session: Session, margin: Margin) -> Self {
        Self {
            session,
            margin,
            precision: Precision::Exact,
            inflated: Vec::new(),
            answered: None,
            spare_keys: Vec::new(),
            stats: MarginStats::default(),
        }
    }

    /// Sends inflated boxes with this precision; exact unless set.
    #[must_use]
    pub fn with_precision(mut self, precision: Precision) -> Self {
        self.precision = precision;
        self
    }

    /// The pairs that overlap among `boxes`, and some that are near: by the last answer where that
    /// is good for them, else by a new one.
    ///
    /// # Errors
    /// [`MarginedError`]. The last answer is kept.
    pub fn cull<'a>(&'a mut self, boxes: &'a [Aabb]) -> Result<Kept<'a>, MarginedError> {
        let (answered, is_earlier) = match self.answered.take() {
            Some(answered) if answered.covers(boxes) => (answered, true),
            old => match self.ask(boxes) {
                Ok(answered) => {
                    self.spare_keys = old.map_or_else(Vec::new, |old| old.keys);
                    (answered, false)
                }
                Err(error) => {
                    self.answered = old;
                    return Err(error);
                }
            },
        };
        let count = if is_earlier { &mut self.stats.skipped } else { &mut self.stats.requests };
        *count += 1;
        let Answered { mask, .. } = self.answered.insert(answered);
        Ok(Kept { mask, boxes, is_earlier })
    }

    fn ask(&mut self, boxes: &[Aabb]) -> Result<Answered, MarginedError> {
        let margin = self.margin;
        self.inflated.resize(boxes.len(), Aabb::EMPTY);
        let tasks = boxes.par_chunks(TASK_BOXES).zip(self.inflated.par_chunks_mut(TASK_BOXES));
        tasks.for_each(|(boxes, out)| margin.inflate_all(boxes, out));
        let mut frame = self.session.narrow_frame(boxes.len(), self.precision)?;
        frame.fill(&self.inflated);
        let mask = frame.submit()?.wait()?;
        let mut keys = std::mem::take(&mut self.spare_keys);
        let found = self.inflated.par_iter().with_min_len(TASK_BOXES).map(KeyBox::from);
        found.collect_into_vec(&mut keys);
        Ok(Answered { mask, keys })
    }

    /// Gives the kept answer up, so that the next frame is asked for.
    pub fn forget(&mut self) {
        self.answered = None;
    }

    /// What was spared so far.
    pub const fn stats(&self) -> MarginStats {
        self.stats
    }

    /// The margin.
    pub const fn margin(&self) -> Margin {
        self.margin
    }

    /// The session, to be asked for its daemon's status for one.
    pub const fn session_mut(&mut self) -> &mut Session {
        &mut self.session
    }
}

/// An answer that holds for the boxes of now, whenever it was given.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a> {
    mask: &'a PairMask,
    boxes: &'a [Aabb],
    is_earlier: bool,
}

impl<'a> Kept<'a> {
    /// The mask: the overlapping pairs, and some that are near. Its
    /// [`info`](PairMask::info) is that of the frame that it answered, census and times included.
    pub const fn mask(&self) -> &'a PairMask {
        self.mask
    }

    /// Whether it is an earlier frame's answer, so that no request was made.
    pub const fn is_earlier(&self) -> bool {
        self.is_earlier
    }

    /// The pairs that overlap now, no more and no less: those of the mask, each tested with the
    /// boxes that were given.
    pub fn exact_pairs(&self) -> impl Iterator<Item = (u32, u32)> + 'a {
        let boxes = self.boxes;
        self.mask.pairs().filter(move |(a, b)| boxes[*a as usize].overlaps(&boxes[*b as usize]))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn margins_are_checked() {
        assert!(Margin::new(0.0).is_ok() && Margin::new(f32::MAX).is_ok());
        for wrong in [-1.0, f32::NAN, f32::INFINITY, -1e-45] {
            assert!(Margin::new(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// A face that moved by the margin at most, in exact arithmetic, is within.
        #[test]
        fn inflated_boxes_reach_as_far_as_the_margin(
            x in -1e6f32..1e6, by in prop_oneof![0.0f32..10.0, 0.0f32..1e-30], share in -1.0f64..=1.0,
        ) {
            let inflated = Margin(by).inflate(&Aabb { min: [x; 3], max: [x; 3] });
            let moved = f64::from(x) + share * f64::from(by);
            // The sum may have been rounded outward; what is truly within is inward of it.
            let (low, high) = (f64::from(inflated.min[0]), f64::from(inflated.max[0]));
            prop_assert!(low <= moved.max(f64::from(x) - f64::from(by)));
            prop_assert!(high >= moved.min(f64::from(x) + f64::from(by)));
            let two_up = inflated.min[0].next_up().next_up();
            prop_assert!(f64::from(two_up) >= f64::from(x) - f64::from(by));
        }
    }
}
