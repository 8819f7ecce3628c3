//! A client whose frames are timed: for the command line's benches and the laboratory.

use std::hint::black_box;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

use pairmask::{Error, FrameInfo, Margin, PairMask, Session};
use pairmask_core::aabb::KeyBox;
use pairmask_core::write::{par_write_boxes, write_boxes};
use pairmask_core::{Aabb, Precision};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

use crate::precision::PrecisionChoice;

#[derive(Debug)]
pub struct TimedClient {
    session: Session,
    precision: Precision,
    /// Where a request is made only when a box has moved by more than a margin.
    margined: Option<Margined>,
}

/// Inflated boxes that were sent, and the answer, which is kept as long as every box lies within its inflated self: two
/// boxes that overlap do so within theirs.
#[derive(Debug)]
struct Margined {
    margin: Margin,
    inflated: Vec<Aabb>,
    answer: Option<PairMask>,
}

/// Boxes that one task compares: fewer take less time than a task costs.
const TASK_BOXES: usize = 16_384;

impl Margined {
    /// The mask, and whether it was asked for.
    fn cull(
        &mut self,
        session: &mut Session,
        boxes: &[Aabb],
    ) -> Result<(&PairMask, bool), TimedError> {
        let kept = self.answer.take().filter(|_| self.covers(boxes));
        let was_asked = kept.is_none();
        let mask = kept.map_or_else(|| self.ask(session, boxes), Ok)?;
        Ok((self.answer.insert(mask), was_asked))
    }

    fn ask(&mut self, session: &mut Session, boxes: &[Aabb]) -> Result<PairMask, TimedError> {
        self.inflated.resize(boxes.len(), Aabb::EMPTY);
        let tasks = boxes.par_chunks(TASK_BOXES).zip(self.inflated.par_chunks_mut(TASK_BOXES));
        tasks.for_each(|(boxes, out)| self.margin.inflate_all(boxes, out));
        let mut frame = session.narrow_frame(boxes.len(), Precision::Exact)?;
        frame.write(&self.inflated)?;
        Ok(frame.submit()?.wait()?)
    }

    /// Compares keys, in which boxes that overlap nothing lie within every box.
    fn covers(&self, boxes: &[Aabb]) -> bool {
        let within = |(sent, now): (&Aabb, &Aabb)| {
            let (sent, now) = (KeyBox::from(sent), KeyBox::from(now));
            (0..3).all(|axis| sent.min[axis] <= now.min[axis] && now.max[axis] <= sent.max[axis])
        };
        let tasks = self.inflated.par_chunks(TASK_BOXES).zip(boxes.par_chunks(TASK_BOXES));
        self.inflated.len() == boxes.len()
            && tasks.all(|(sent, now)| sent.iter().zip(now).all(within))
    }
}

/// The client's threads, which write exact boxes and decode masks: more than one in a pool.
#[derive(Debug, Default)]
pub struct Decoding {
    pool: Option<ThreadPool>,
}

impl Decoding {
    /// Starts `threads` threads, of which the calling one is the first. They are kept awake while frames are under way.
    pub fn start(threads: NonZeroUsize) -> Result<Self, TimedError> {
        let pool = ThreadPoolBuilder::new().num_threads(threads.get()).use_current_thread();
        Ok(Self { pool: (threads.get() > 1).then(|| pool.build()).transpose()? })
    }

    fn write(&self, boxes: &[Aabb], out: &mut [Aabb]) {
        if self.pool.is_some() { par_write_boxes(boxes, out) } else { write_boxes(boxes, out) }
    }

    /// The number of pairs, all of which are iterated over.
    fn look(&self, mask: &PairMask) -> u64 {
        let (mut count, mut indices) = (0, 0);
        if self.pool.is_some() {
            let parts = mask.par_pairs().fold(|| (0, 0), |(n, i), [a, b]| (n + 1, i ^ a ^ b));
            (count, indices) = parts.reduce(|| (0, 0), |one, two| (one.0 + two.0, one.1 ^ two.1));
        } else {
            mask.for_each_slice(|pairs| {
                count += pairs.len() as u64;
                indices = pairs.iter().fold(indices, |indices, [a, b]| indices ^ a ^ b);
            });
        }
        // The compiler keeps the iteration for it.
        black_box(indices);
        count
    }
}

#[derive(Clone, Copy, Debug)]
pub struct TimedFrame {
    pub info: FrameInfo,
    /// Whether a request was made: else an earlier answer held.
    pub was_asked: bool,
    /// Time to borrow memory and write boxes; zero with a margin, where the round trip has it.
    pub fill: Duration,
    pub round_trip: Duration,
    /// Time to iterate over every pair of the mask once.
    pub decode: Duration,
}

impl TimedFrame {
    /// Iterates over every pair. The times are those at which the frame began, was filled and was answered.
    pub fn of(
        mask: &PairMask,
        decoding: &Decoding,
        was_asked: bool,
        [start, filled, answered]: [Instant; 3],
    ) -> Result<Self, TimedError> {
        let decoded = decoding.look(mask);
        let decode = answered.elapsed();
        let counted = mask.count();
        if counted != decoded {
            return Err(TimedError::Miscounted { counted, decoded });
        }
        let (fill, round_trip) = (filled - start, answered - filled);
        Ok(Self { info: *mask.info(), was_asked, fill, round_trip, decode })
    }

    /// The engine's part of the round trip, ns; 0 where no request was made.
    pub const fn engine_ns(&self) -> u64 {
        if self.was_asked { self.info.times.total_ns } else { 0 }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum TimedError {
    #[error(transparent)]
    Session(#[from] Error),
    #[error("a frame has {counted} pairs and its mask holds {decoded}: please report this")]
    Miscounted { counted: u64, decoded: u64 },
    #[error("the decoding threads cannot be started: {0}")]
    Threads(#[from] ThreadPoolBuildError),
}

impl TimedClient {
    /// A client that writes boxes with a precision; its bounds are those of `boxes`.
    pub fn new(session: Session, precision: PrecisionChoice, boxes: &[Aabb]) -> Self {
        let margined = match precision {
            PrecisionChoice::Margin(margin) => {
                Some(Margined { margin, inflated: Vec::new(), answer: None })
            }
            _ => None,
        };
        Self { session, precision: precision.precision(boxes), margined }
    }

    /// Runs a frame of boxes. `look` gets the mask after the clock has stopped.
    pub fn frame(
        &mut self,
        boxes: &[Aabb],
        decoding: &Decoding,
        look: impl FnOnce(&PairMask),
    ) -> Result<TimedFrame, TimedError> {
        let start = Instant::now();
        if let Some(margined) = &mut self.margined {
            let (mask, was_asked) = margined.cull(&mut self.session, boxes)?;
            let times = [start, start, Instant::now()];
            return TimedFrame::of(mask, decoding, was_asked, times).inspect(|_| look(mask));
        }
        let (pending, filled) = if self.precision == Precision::Exact {
            let mut frame = self.session.frame(boxes.len())?;
            decoding.write(boxes, frame.boxes_mut());
            let filled = Instant::now();
            (frame.submit()?, filled)
        } else {
            let mut frame = self.session.narrow_frame(boxes.len(), self.precision)?;
            frame.write(boxes)?;
            let filled = Instant::now();
            (frame.submit()?, filled)
        };
        let mask = pending.wait()?;
        let times = [start, filled, Instant::now()];
        TimedFrame::of(&mask, decoding, true, times).inspect(|_| look(&mask))
    }
}
