//! What an engine has to do for a frame, counted in units that one constant each gives a time.
//!
//! The cost model is a sum of products: a count of this module times a constant of the
//! [`Calibration`](super::Calibration). A fit may therefore solve for all constants at once, and
//! cannot drift from what the plan computes.

use std::fmt;

use crate::engine::EngineName;
use crate::engine::brute_force::BITMAP_BOXES;
use crate::mask::Encoding;
use crate::stats::SceneStats;

/// A kind of work with a constant of its own, ns a unit on one thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(usize)]
pub enum Term {
    /// A frame of `cpu-brute`.
    BruteFrame,
    /// A box of `cpu-brute`.
    BruteBox,
    /// A pair that `cpu-brute` compares at once, having too few boxes for bitmaps.
    BruteDirectTest,
    /// A frame of `cpu-brute` with bitmaps.
    BruteBitmapFrame,
    /// More for a box of `cpu-brute` with bitmaps.
    BruteBitmapBox,
    /// A pair that `cpu-brute` looks up in its bitmaps.
    BruteBitmapTest,
    /// A pair that its bitmaps do not rule out and whose keys are compared.
    BruteCandidate,
    /// A frame of `cpu-sap`.
    SapFrame,
    /// A box of `cpu-sap`: read, sorted, put in order.
    SapBox,
    /// A box of `cpu-sap` and doubling of a scene above what the caches hold.
    SapSpill,
    /// A pair of a sweep's window.
    SapTest,
    /// A frame of `cpu-grid`.
    GridFrame,
    /// A box that `cpu-grid` looks at to lay out its cells.
    GridSample,
    /// More for a box that it looks at where sizes differ so much that it chooses levels.
    GridLevels,
    /// A box of `cpu-grid`.
    GridBox,
    /// A box of `cpu-grid` and doubling of a scene above what the caches hold.
    GridSpill,
    /// A box of `cpu-grid` and doubling of the large sizes over the median.
    GridDoubling,
    /// A box of `cpu-grid` and unit of elongation above 2.
    GridElongation,
    /// A pair in sparse words of boxes in their own order: kept, published, decoded.
    SparsePair,
    /// More for a pair in sparse words of an order of the engine's.
    OrderedPair,
    /// A byte of a dense mask: written, and scanned by the client.
    DenseByte,
    /// A pair in a dense mask.
    DensePair,
    /// More for a pair that an engine with an order of its own puts into a dense mask.
    ScatteredPair,
}

impl Term {
    /// Every term, in the order of their numbers.
    pub const ALL: [Self; 23] = [
        Self::BruteFrame,
        Self::BruteBox,
        Self::BruteDirectTest,
        Self::BruteBitmapFrame,
        Self::BruteBitmapBox,
        Self::BruteBitmapTest,
        Self::BruteCandidate,
        Self::SapFrame,
        Self::SapBox,
        Self::SapSpill,
        Self::SapTest,
        Self::GridFrame,
        Self::GridSample,
        Self::GridLevels,
        Self::GridBox,
        Self::GridSpill,
        Self::GridDoubling,
        Self::GridElongation,
        Self::SparsePair,
        Self::OrderedPair,
        Self::DenseByte,
        Self::DensePair,
        Self::ScatteredPair,
    ];

    /// The name in calibration files.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::BruteFrame => "brute-frame",
            Self::BruteBox => "brute-box",
            Self::BruteDirectTest => "brute-direct-test",
            Self::BruteBitmapFrame => "brute-bitmap-frame",
            Self::BruteBitmapBox => "brute-bitmap-box",
            Self::BruteBitmapTest => "brute-bitmap-test",
            Self::BruteCandidate => "brute-candidate",
            Self::SapFrame => "sap-frame",
            Self::SapBox => "sap-box",
            Self::SapSpill => "sap-spill",
            Self::SapTest => "sap-test",
            Self::GridFrame => "grid-frame",
            Self::GridSample => "grid-sample",
            Self::GridLevels => "grid-levels",
            Self::GridBox => "grid-box",
            Self::GridSpill => "grid-spill",
            Self::GridDoubling => "grid-doubling",
            Self::GridElongation => "grid-elongation",
            Self::SparsePair => "sparse-pair",
            Self::OrderedPair => "ordered-pair",
            Self::DenseByte => "dense-byte",
            Self::DensePair => "dense-pair",
            Self::ScatteredPair => "scattered-pair",
        }
    }

    /// The term of a name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|term| term.as_str() == name)
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Columns that a row still compares, for each pair that it finds, once the bitmaps have ruled out
/// the rest.
const CANDIDATES_A_PAIR: f64 = 24.0;
/// Columns of a sweep's window that are compared for nothing: strips are tested whole.
const STRIP_WASTE: f64 = 8.0;
/// Boxes whose keys and order the caches of one core hold.
const CACHED_BOXES: f64 = 65_536.0;
/// Boxes that the grid looks at to lay out its cells: one in so many …
const GRID_SAMPLE_SHARE: f64 = 16.0;
/// … but as many as this, if there are …
const GRID_SAMPLE_LEAST: f64 = 256.0;
/// … and no more than this.
const GRID_SAMPLE_MOST: f64 = 1_024.0;
/// Doublings of the large sizes over the median that are counted: beyond, giants have levels of
/// their own.
const DOUBLINGS_MOST: f64 = 4.0;

/// How much of each [`Term`] a frame holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Work {
    amounts: [f64; Term::ALL.len()],
}

impl Work {
    /// The work of a CPU engine, `None` for a GPU's.
    pub fn of(engine: EngineName, encoding: Encoding, stats: &SceneStats) -> Option<Self> {
        let mut work = Self { amounts: [0.0; Term::ALL.len()] };
        match engine {
            EngineName::CpuBrute => work.add_brute(stats),
            EngineName::CpuSap => work.add_sap(stats),
            EngineName::CpuGrid => work.add_grid(stats),
            EngineName::GpuBrute | EngineName::GpuGrid => return None,
        }
        work.add_mask(encoding, stats, engine != EngineName::CpuBrute);
        Some(work)
    }

    /// The mask alone, of an engine that has an order of its own or keeps the boxes'.
    pub fn of_mask(encoding: Encoding, stats: &SceneStats, is_ordered: bool) -> Self {
        let mut work = Self { amounts: [0.0; Term::ALL.len()] };
        work.add_mask(encoding, stats, is_ordered);
        work
    }

    /// How much of one term.
    pub const fn amount(&self, term: Term) -> f64 {
        self.amounts[term as usize]
    }

    /// All amounts, in the order of [`Term::ALL`].
    pub const fn amounts(&self) -> &[f64; Term::ALL.len()] {
        &self.amounts
    }

    fn set(&mut self, term: Term, amount: f64) {
        self.amounts[term as usize] = amount;
    }

    fn add_brute(&mut self, stats: &SceneStats) {
        let tests = stats.n.pair_count() as f64;
        self.set(Term::BruteFrame, 1.0);
        self.set(Term::BruteBox, boxes(stats));
        if stats.n.len() < BITMAP_BOXES {
            self.set(Term::BruteDirectTest, tests);
        } else {
            self.set(Term::BruteBitmapFrame, 1.0);
            self.set(Term::BruteBitmapBox, boxes(stats));
            self.set(Term::BruteBitmapTest, tests);
            let candidates = CANDIDATES_A_PAIR * stats.expected_pairs();
            self.set(Term::BruteCandidate, candidates.min(tests));
        }
    }

    fn add_sap(&mut self, stats: &SceneStats) {
        let n = boxes(stats);
        let solid = n * f64::from(stats.solid_share);
        let window = solid * f64::from(stats.window_share) + STRIP_WASTE;
        self.set(Term::SapFrame, 1.0);
        self.set(Term::SapBox, n);
        self.set(Term::SapSpill, n * spills(n));
        // Whatever the sample says, each pair that is found was in the window.
        self.set(Term::SapTest, (solid * window).max(stats.expected_pairs()));
    }

    fn add_grid(&mut self, stats: &SceneStats) {
        let n = boxes(stats);
        let spread = f64::from(stats.large_size / stats.median_size);
        let doublings = if spread.is_finite() { spread.max(1.0).log2() } else { 0.0 };
        self.set(Term::GridFrame, 1.0);
        let sample = (n / GRID_SAMPLE_SHARE).clamp(GRID_SAMPLE_LEAST, GRID_SAMPLE_MOST).min(n);
        self.set(Term::GridSample, sample);
        self.set(Term::GridLevels, if doublings > 1.0 { sample } else { 0.0 });
        self.set(Term::GridBox, n);
        self.set(Term::GridSpill, n * spills(n));
        self.set(Term::GridDoubling, n * doublings.min(DOUBLINGS_MOST));
        self.set(Term::GridElongation, n * f64::from((stats.elongation - 2.0).max(0.0)));
    }

    fn add_mask(&mut self, encoding: Encoding, stats: &SceneStats, is_ordered: bool) {
        let pairs = stats.expected_pairs();
        let ordered = if is_ordered { pairs } else { 0.0 };
        match encoding {
            Encoding::Dense => {
                self.set(Term::DenseByte, 4.0 * stats.n.dense_words() as f64);
                self.set(Term::DensePair, pairs);
                self.set(Term::ScatteredPair, ordered);
            }
            Encoding::Sparse => {
                self.set(Term::SparsePair, pairs);
                self.set(Term::OrderedPair, ordered);
            }
        }
    }
}

fn boxes(stats: &SceneStats) -> f64 {
    f64::from(stats.n.get())
}

/// Doublings of a scene above what the caches hold.
fn spills(n: f64) -> f64 {
    (n / CACHED_BOXES).max(1.0).log2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_are_numbered_and_named_apart() {
        for (number, term) in Term::ALL.into_iter().enumerate() {
            assert_eq!(term as usize, number);
            assert_eq!(Term::from_name(term.as_str()), Some(term));
        }
        assert_eq!(Term::from_name("no-such-term"), None);
    }

    #[test]
    fn every_term_is_work_of_some_engine_and_none_is_negative() {
        let mut seen = [false; Term::ALL.len()];
        for n in [0, 10, 1_000, 1_000_000] {
            let stats = SceneStats {
                solid_share: 1.0,
                median_size: 1.0,
                large_size: 100.0,
                elongation: 50.0,
                ..SceneStats::unseen(crate::BoxCount::new(n), None)
            };
            for engine in EngineName::ALL {
                for encoding in [Encoding::Dense, Encoding::Sparse] {
                    let Some(work) = Work::of(engine, encoding, &stats) else {
                        assert!(engine.is_gpu());
                        continue;
                    };
                    for (seen, amount) in seen.iter_mut().zip(work.amounts()) {
                        assert!(amount.is_finite() && *amount >= 0.0, "{engine} {n}");
                        *seen |= *amount > 0.0;
                    }
                }
            }
        }
        assert_eq!(seen, [true; Term::ALL.len()]);
    }
}
