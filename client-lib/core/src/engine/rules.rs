//! Which pairs count, beyond those whose boxes overlap.

/// A test of pairs beyond that of their boxes.
pub(crate) trait PairTest: Sync {
    /// The bits of a mask word whose pairs pass. `order` is the box index at each position, empty
    /// where positions are indices.
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32;
}

/// What a pair must pass, beyond that its boxes overlap, to be in the mask. Engines hand the words
/// that they find to [`PairRules::passing`], some thousand at a time, by way of `Gather`.
#[derive(Clone, Copy)]
pub(crate) struct PairRules<'a> {
    /// A test of each pair.
    pub test: Option<&'a dyn PairTest>,
}

impl PairRules<'_> {
    /// All pairs of boxes that overlap count.
    pub const NONE: Self = Self { test: None };

    /// Whether all pairs pass: then no word need be looked at.
    #[inline]
    pub fn pass_all(&self) -> bool {
        let Self { test } = self;
        test.is_none()
    }

    /// The bits of a mask word whose pairs pass. `order` is the box index at each position, empty
    /// where positions are indices.
    #[inline]
    pub fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let Self { test } = self;
        test.map_or(bits, |test| bits & test.passing(row, block, bits, order))
    }
}
