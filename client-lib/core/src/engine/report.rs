//! What an engine says of a frame.

use std::time::Instant;

use super::Census;
use crate::mask::MaskShape;
use crate::units::BoxCount;

/// What an engine did not have to do. All counts are of this frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkipMeter {
    /// Boxes that were not looked at: empty and invalid ones, left out before any pair is tested; all of
    /// them where the frame is equal to the last one.
    pub boxes: u64,
    /// Pairs that were never compared, of n(n − 1)/2.
    pub pairs: u64,
    /// Why those were not. Adds up to them.
    pub why: PairSkips,
    /// Mask words that are zero and were therefore not sent (sparse encoding only).
    pub zero_words: u64,
}

impl SkipMeter {
    /// The meter of a frame of `n` boxes that is equal to the last one, whose meter is `last`.
    pub const fn of_repeat(n: BoxCount, last: &Self) -> Self {
        let pairs = n.pair_count();
        let why = PairSkips { unmoved: pairs, ..PairSkips::NONE };
        Self { boxes: n.get() as u64, pairs, why, zero_words: last.zero_words }
    }

    /// Whether the frame was equal to the last one, so that no engine looked at it.
    pub const fn is_repeat(&self) -> bool {
        self.why.unmoved > 0
    }
}

/// Pairs that were not tested, by the first reason that holds. Whole frames and scenes count alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PairSkips {
    /// Of two static boxes (scenes).
    pub statics: u64,
    /// Of two boxes that have not moved since the last answer.
    pub unmoved: u64,
    /// Of at least one empty or invalid box.
    pub empty: u64,
    /// Of boxes in cells too far apart; and those that a daemon before wire 1.4 left out.
    pub cell: u64,
    /// Of boxes that the order along an axis, or the bounds of groups, hold apart.
    pub axis: u64,
}

impl PairSkips {
    /// No pair.
    pub const NONE: Self = Self { statics: 0, unmoved: 0, empty: 0, cell: 0, axis: 0 };

    /// Pairs of a whole frame, beside those of cells.
    pub const fn of_frame(unmoved: u64, empty: u64, axis: u64) -> Self {
        Self { unmoved, empty, axis, ..Self::NONE }
    }

    /// Pairs of a persistent scene.
    pub const fn of_scene(statics: u64, unmoved: u64, cell: u64) -> Self {
        Self { statics, unmoved, cell, ..Self::NONE }
    }

    /// All of them.
    pub const fn total(&self) -> u64 {
        let Self { statics, unmoved, empty, cell, axis } = *self;
        statics
            .saturating_add(unmoved)
            .saturating_add(empty)
            .saturating_add(cell)
            .saturating_add(axis)
    }

    /// Of so many pairs in all, those that no other reason explains are a matter of cells.
    #[must_use]
    pub const fn with_cells_of(self, total: u64) -> Self {
        let others = Self { cell: 0, ..self }.total();
        Self { cell: total.saturating_sub(others), ..self }
    }
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

impl EngineTimes {
    /// All stages.
    pub const fn sum_ns(&self) -> u64 {
        self.ingest_ns + self.execute_ns + self.publish_ns
    }
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
        let nothing = u64::from(census.empty) + u64::from(census.invalid);
        let valid = u64::from(n.get()).saturating_sub(nothing);
        let of_valid = valid * valid.saturating_sub(1) / 2;
        let pairs = n.pair_count().saturating_sub(compared);
        let empty = (n.pair_count() - of_valid).min(pairs);
        let skipped = SkipMeter {
            boxes: nothing,
            pairs,
            why: PairSkips::of_frame(0, empty, 0).with_cells_of(pairs),
            zero_words: shape.zero_words(n),
        };
        Self { shape, census, pair_count, skipped, times }
    }

    /// The same of an engine without cells: what it left out is apart on an axis.
    #[must_use]
    pub const fn apart_on_axes(mut self) -> Self {
        let why = &mut self.skipped.why;
        (why.axis, why.cell) = (why.cell, 0);
        self
    }
}
