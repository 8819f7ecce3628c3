//! Which pairs count, beyond those whose boxes overlap.

/// A test of pairs beyond that of their boxes.
pub(crate) trait PairTest: Sync {
    /// The bits of a mask word whose pairs pass. `order` is the box index at each position, empty
    /// where positions are indices.
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32;

    /// Asks for the memory that [`Self::passing`] will read for a word.
    fn ask_for(&self, _row: u32, _block: u32, _bits: u32) {}

    /// Hears the order before any word is tested, so that what the test reads may be laid out by
    /// position. Engines with an order of their own for large scenes say it; `threads` is theirs.
    fn prepare(&self, _order: &[u32], _threads: usize) {}
}

/// What a pair must pass, beyond that its boxes overlap, to be in the mask. Engines hand the words
/// that they find to [`PairRules::passing`], some thousand at a time, by way of `Gather`.
#[derive(Clone, Copy)]
pub(crate) struct PairRules<'a> {
    /// A test of each pair.
    test: Option<&'a dyn PairTest>,
}

impl<'a> PairRules<'a> {
    /// All pairs of boxes that overlap count.
    pub const NONE: Self = Self { test: None };

    /// Pairs of boxes that overlap count where they pass a test.
    pub const fn tested_by(test: &'a dyn PairTest) -> Self {
        Self { test: Some(test) }
    }

    /// Whether all pairs pass: then no word need be looked at.
    #[inline]
    pub fn pass_all(&self) -> bool {
        let Self { test } = self;
        test.is_none()
    }

    /// Tells the test, if there is one, the order of the boxes.
    pub fn prepare(&self, order: &[u32], threads: usize) {
        let Self { test } = self;
        if let Some(test) = test {
            test.prepare(order, threads);
        }
    }

    /// Asks for the memory that the test of a word will read.
    #[inline]
    pub fn ask_for(&self, row: u32, block: u32, bits: u32) {
        let Self { test } = self;
        if let Some(test) = test {
            test.ask_for(row, block, bits);
        }
    }

    /// The bits of a mask word whose pairs pass. `order` is the box index at each position, empty
    /// where positions are indices.
    #[inline]
    pub fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let Self { test } = self;
        test.map_or(bits, |test| bits & test.passing(row, block, bits, order))
    }
}
