//! The contenders of a row: boxes through a session, a world through a session, or spheres.

use std::time::Duration;

use pairmask::{PairMask, Session};
use pairmask_core::Aabb;
use pairmask_core::dispatch::{CullOptions, StageTimes};
use pairmask_core::engine::EngineId;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::timed_client::{TimedClient, TimedError, TimedFrame};

use super::mode::StudyMode;
use super::spheres::SphereClient;
use super::truth::{self, Pair};
use super::world::WorldClient;

/// A way to answer the frames of a scene, and its right answers.
pub trait Contender {
    /// Answers a frame of boxes. The answer has `pairs` if `wants_pairs`.
    ///
    /// # Errors
    /// [`TimedError`].
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError>;

    /// The right pairs of the last frame, sorted, found in another way than by `engine`.
    ///
    /// # Errors
    /// [`TimedError`] where that way cannot answer.
    fn truth(&self, boxes: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError>;

    /// Whether other objects stand for the boxes, so that the answers are also compared with the
    /// boxes' own pairs.
    fn stands_for_boxes(&self) -> bool {
        false
    }
}

/// An answered frame.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Times and sizes.
    pub figures: FrameFigures,
    /// The pairs, sorted, if they were wanted.
    pub pairs: Option<Vec<Pair>>,
}

/// Times and sizes of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameFigures {
    /// What answered: `daemon` or `in-process`.
    pub backend: &'static str,
    /// The engine.
    pub engine: EngineId,
    /// Whether a request was made; else an earlier answer held.
    pub was_asked: bool,
    /// Time to write the objects in the form in which they are culled.
    pub fill: Duration,
    /// From submission to the mask.
    pub round_trip: Duration,
    /// Time to visit every pair of the mask once.
    pub decode: Duration,
    /// The engine's time by stage; zeros where no request was made.
    pub stages: StageTimes,
    /// Bytes of the objects that were culled.
    pub box_bytes: u64,
    /// Bytes of the mask.
    pub mask_bytes: u64,
}

impl From<&TimedFrame> for FrameFigures {
    fn from(frame: &TimedFrame) -> Self {
        let TimedFrame { info, was_asked, fill, round_trip, decode } = *frame;
        Self {
            backend: info.served_by.as_str(),
            engine: info.engine,
            was_asked,
            fill,
            round_trip,
            decode,
            stages: if was_asked { info.times } else { StageTimes::default() },
            box_bytes: info.box_bytes,
            mask_bytes: info.mask_bytes,
        }
    }
}

/// The contender of a mode. Spheres are culled in this process, by the engine of `options`; all others
/// in the session, which has its own choice of engine.
pub fn contender(
    mode: StudyMode,
    options: &CullOptions,
    session: Session,
    boxes: &[Aabb],
) -> Box<dyn Contender> {
    match mode {
        StudyMode::Sent(precision) => Box::new(BoxClient::new(session, precision, boxes)),
        StudyMode::World(world) => Box::new(WorldClient::new(session, world, boxes)),
        StudyMode::Spheres(fit) => Box::new(SphereClient::new(fit, *options)),
    }
}

/// The scene's boxes in a precision.
struct BoxClient(TimedClient);

impl BoxClient {
    fn new(session: Session, precision: PrecisionChoice, boxes: &[Aabb]) -> Self {
        Self(TimedClient::new(session, precision, boxes))
    }
}

impl Contender for BoxClient {
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError> {
        let mut pairs = None;
        let frame = self.0.frame(boxes, |mask| pairs = wants_pairs.then(|| sorted(mask)))?;
        Ok(Answer { figures: FrameFigures::from(&frame), pairs })
    }

    fn truth(&self, boxes: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        truth::pairs(boxes, engine)
    }
}

/// The pairs of a mask.
pub(super) fn sorted(mask: &PairMask) -> Vec<Pair> {
    let mut pairs = mask.to_vec();
    pairs.sort_unstable();
    pairs
}
