//! What an engine says of a frame.

use std::time::Instant;

use super::Census;
use crate::mask::MaskShape;
use crate::units::BoxCount;

/// What an engine did not have to do. All counts are of this frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkipMeter {
    /// Empty and invalid boxes, left out before any pair is tested.
    pub boxes: u64,
    /// Pairs that were never compared, of n(n − 1)/2.
    pub pairs: u64,
    /// Mask words that are zero and were therefore not sent (sparse encoding only).
    pub zero_words: u64,
}

/// Time of an engine's stages, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EngineTimes {
    /// Boxes read and turned into the engine's own form (keys, order, cells).
    pub ingest_ns: u64,
    /// Pairs tested.
    pub execute_ns: u64,
    /// Mask written into the reply.
    pub publish_ns: u64,
}

/// The times of an engine's stages, taken as each of them ends.
#[derive(Clone, Copy, Debug)]
pub struct StageClock {
    /// When the stage under way began.
    began: Instant,
    times: EngineTimes,
}

impl StageClock {
    /// Begins with the ingest.
    pub fn start() -> Self {
        Self { began: Instant::now(), times: EngineTimes::default() }
    }

    /// Ends the ingest.
    pub fn ingested(&mut self) {
        self.times.ingest_ns = self.lap();
    }

    /// Ends the test of pairs.
    pub fn executed(&mut self) {
        self.times.execute_ns = self.lap();
    }

    /// Ends the writing of the mask, and with it the frame.
    #[must_use]
    pub fn published(mut self) -> EngineTimes {
        self.times.publish_ns = self.lap();
        self.times
    }

    /// ns of the stage that ends now.
    fn lap(&mut self) -> u64 {
        let began = std::mem::replace(&mut self.began, Instant::now());
        (self.began - began).as_nanos() as u64
    }
}

/// What an engine says of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CullReport {
    /// Where the mask lies in the reserved memory.
    pub shape: MaskShape,
    /// Boxes that overlap nothing.
    pub census: Census,
    /// Pairs in the mask.
    pub pair_count: u64,
    /// Work left out.
    pub skipped: SkipMeter,
    /// Time by stage.
    pub times: EngineTimes,
}

impl CullReport {
    /// The report of a frame of `n` boxes whose mask of `pair_count` pairs lies as `shape` says, and
    /// for which `compared` pairs were compared. What was left out follows from these.
    pub fn new(
        n: BoxCount,
        shape: MaskShape,
        census: Census,
        pair_count: u64,
        compared: u64,
        times: EngineTimes,
    ) -> Self {
        let skipped = SkipMeter {
            boxes: u64::from(census.empty) + u64::from(census.invalid),
            pairs: n.pair_count().saturating_sub(compared),
            zero_words: shape.zero_words(n),
        };
        Self { shape, census, pair_count, skipped, times }
    }
}
