//! Which pairs count, beyond those whose boxes overlap.

use std::sync::{Mutex, OnceLock, PoisonError};

use super::AvailableIsa;

/// Words from one that is tested to one whose memory is asked for meanwhile.
const AHEAD: usize = 16;

/// A test of pairs beyond that of their boxes.
pub(crate) trait PairTest: Sync {
    /// The bits of a mask word whose pairs pass. `order` is the box index at each position, empty
    /// where positions are indices.
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32;

    /// Keeps what passes of some words: those without bits go, and the others close up. Returns how many
    /// stay at the front, and how many pairs went.
    fn sift(&self, words: [&mut [u32]; 3], order: &[u32], _isa: AvailableIsa) -> (usize, u64) {
        let passing = |row, block, bits| self.passing(row, block, bits, order);
        sift_each(words, passing, |word| self.ask_for(word))
    }

    /// Asks for the memory that [`Self::passing`] will read for a row, a block and bits.
    fn ask_for(&self, _word: [u32; 3]) {}

    /// Notes how many boxes there are and their order, empty where positions are indices, before any word is
    /// tested, so that what the test reads may be laid out by position. Engines say it for scenes that are
    /// not small; `threads` is theirs.
    fn prepare(&self, _count: usize, _order: &[u32], _threads: usize) {}
}

/// What a test lays out once the engine has said its order, in memory that is kept from frame to frame.
pub(crate) struct Prepared<T> {
    /// For the order of the engine that began the frame, and of the one that it was handed over to.
    ready: [OnceLock<T>; 2],
    memory: Mutex<T>,
}

impl<T: Default> Prepared<T> {
    /// Nothing yet, in the memory of an earlier frame.
    pub const fn new(memory: T) -> Self {
        Self { ready: [OnceLock::new(), OnceLock::new()], memory: Mutex::new(memory) }
    }

    /// What was laid out last.
    #[inline]
    pub fn get(&self) -> Option<&T> {
        let [first, second] = &self.ready;
        second.get().or_else(|| first.get())
    }

    /// Lays out by `fill`, unless that says that it cannot, which must not depend on the order. Two engines at
    /// most run, one after the other, and each says its order once.
    pub fn prepare(&self, fill: impl FnOnce(&mut T) -> bool) {
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        if fill(&mut memory) {
            let laid = std::mem::take(&mut *memory);
            let _ = self.ready[0].set(laid).or_else(|laid| self.ready[1].set(laid));
        }
    }

    /// Gives the memory back for the next frame.
    pub fn into_memory(self) -> T {
        let kept = self.memory.into_inner().unwrap_or_else(PoisonError::into_inner);
        let [first, second] = self.ready;
        second.into_inner().or(first.into_inner()).unwrap_or(kept)
    }
}

/// Sifts words one after the other; see [`PairTest::sift`].
pub(crate) fn sift_each(
    [rows, blocks, bits]: [&mut [u32]; 3],
    passing: impl Fn(u32, u32, u32) -> u32,
    ask_for: impl Fn([u32; 3]),
) -> (usize, u64) {
    let (mut kept, mut ended) = (0, 0);
    for at in 0..bits.len() {
        if let Some(ahead) = bits.get(at + AHEAD) {
            ask_for([rows[at + AHEAD], blocks[at + AHEAD], *ahead]);
        }
        let (row, block) = (rows[at], blocks[at]);
        let before = bits[at];
        let passing = passing(row, block, before);
        ended += u64::from((before ^ passing).count_ones());
        (rows[kept], blocks[kept], bits[kept]) = (row, block, passing);
        kept += usize::from(passing != 0);
    }
    (kept, ended)
}

/// What a pair must pass, beyond that its boxes overlap, to be in the mask. Engines hand the words
/// that they find to [`PairRules::sift`], some thousand at a time, by way of `Gather`.
#[derive(Clone, Copy)]
pub(crate) struct PairRules<'a> {
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
        self.test.is_none()
    }

    /// Informs the test, if there is one, how many boxes there are and their order.
    pub fn prepare(&self, count: usize, order: &[u32], threads: usize) {
        if let Some(test) = self.test {
            test.prepare(count, order, threads);
        }
    }

    /// Keeps what passes of some words; see [`PairTest::sift`].
    pub fn sift(&self, words: [&mut [u32]; 3], order: &[u32], isa: AvailableIsa) -> (usize, u64) {
        let all = words[2].len();
        self.test.map_or((all, 0), |test| test.sift(words, order, isa))
    }
}
