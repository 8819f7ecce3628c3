//! Margins: an answer that stays good while nothing has moved far.
//!
//! Boxes are inflated by a margin when they are sent. As long as every box lies within its inflated
//! self, every pair that overlaps now is a pair of the last answer: two boxes that share a point
//! share it inside their inflated selves. So the last mask is kept and no request is made.
//!
//! That a box lies within its inflated self is decided by comparing integer keys, so rounding has
//! no part in the proof. Rounding decides only how long an answer is kept ([`Margin::inflate`]).

use pairmask_core::aabb::{Aabb, KeyBox};
use pairmask_core::precision::{Margin, Precision};
use rayon::prelude::*;

use super::Session;
use super::error::{FrameError, WaitError};
use super::pairs::PairMask;

/// Boxes that one task compares: fewer take less time than a task costs.
const TASK_BOXES: usize = 16_384;

/// Frames that were requested, and frames that an earlier answer served.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MarginStats {
    /// Frames for which a request was made.
    pub requests: u64,
    /// Frames that the last answer served.
    pub skipped: u64,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
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
/// A mask is a superset of the overlapping pairs: it has those, and pairs of boxes whose gap was at
/// most [`Margin::gap_limit`] when they were sent: twice the margin, steps of f32 and what the
/// precision adds. [`MarginedMask::exact_pairs`] tests each pair with the boxes of now.
///
/// One box that leaves its margin has all of them sent. [`Session::margined_scene`] sends that box alone.
///
/// The kept mask is one of the three frames that a session has at a time.
///
/// ```
/// use pairmask_core::precision::Margin;
/// use pairmask::Margined;
/// use pairmask_core::Aabb;
/// use pairmask::{Backend, Session};
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
    /// Memory of a discarded answer, for the next one.
    spare_keys: Vec<KeyBox>,
    stats: MarginStats,
}

/// The last answer, and the inflated boxes that were sent for it.
#[derive(Debug)]
struct Answered {
    mask: PairMask,
    keys: Vec<KeyBox>,
}

impl Answered {
    /// Whether every box lies within its inflated self. A box that has become empty or invalid lies
    /// within every box. A box that was empty or invalid and is solid now lies within none. The
    /// keys of [`KeyBox::NOTHING`] give both without a special case.
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

    /// The pairs that overlap among `boxes`, and some that are near: from the last answer where
    /// every box lies within its inflated self, else from a new one.
    ///
    /// # Errors
    /// [`MarginedError`]. The last answer is kept.
    pub fn cull<'a>(&'a mut self, boxes: &'a [Aabb]) -> Result<MarginedMask<'a>, MarginedError> {
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
        Ok(MarginedMask { mask, boxes, is_earlier })
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

    /// Discards the kept answer, so that the next frame makes a request.
    pub fn forget(&mut self) {
        self.answered = None;
    }

    /// Requests made and saved so far.
    pub const fn stats(&self) -> MarginStats {
        self.stats
    }

    /// The margin.
    pub const fn margin(&self) -> Margin {
        self.margin
    }

    /// The session, for instance to ask for its daemon's status.
    pub const fn session_mut(&mut self) -> &mut Session {
        &mut self.session
    }
}

/// An answer that holds for the boxes of now; it may be an earlier frame's.
#[derive(Clone, Copy, Debug)]
pub struct MarginedMask<'a> {
    mask: &'a PairMask,
    boxes: &'a [Aabb],
    is_earlier: bool,
}

impl<'a> MarginedMask<'a> {
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
