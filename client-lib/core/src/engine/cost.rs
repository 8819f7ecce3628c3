//! What work costs: the terms of the plan's cost model, beside the engines and encodings whose work
//! they count.

use crate::isa::Isa;
use crate::stats::SceneStats;

/// A kind of work: how much of it a frame holds, and what a unit takes.
#[derive(Clone, Copy, Debug)]
pub struct CostTerm {
    /// Built-in ns a unit on one thread, for each of [`Isa::ALL`].
    ns: [f64; Isa::ALL.len()],
    amount: Amount,
}

/// Units in a frame, of an engine that has an order of its own or keeps the boxes'.
type Amount = fn(&SceneStats, bool) -> f64;

/// How much longer than AVX-512 an instruction set takes for what it does a register at a time, for
/// each of [`Isa::ALL`].
const BY_LANES: [f64; Isa::ALL.len()] = [1.0, 1.6, 6.0];

// Built-in figures are those of one core of an AMD EPYC 9004 (Zen 4, AVX-512) at 2.6 GHz, fitted to the times of
// many scenes.
impl CostTerm {
    /// Work that takes `ns` a unit with every instruction set.
    pub const fn new(ns: f64, amount: Amount) -> Self {
        Self { ns: [ns; Isa::ALL.len()], amount }
    }

    /// Work that takes `ns` a unit with AVX-512, and longer with fewer lanes.
    pub const fn by_lanes(ns: f64, amount: Amount) -> Self {
        let [avx512, avx2, portable] = BY_LANES;
        Self { ns: [avx512 * ns, avx2 * ns, portable * ns], amount }
    }

    /// Work that takes `ns` a unit with AVX-512, and `narrow_ns` with all others.
    pub const fn avx512_or(ns: f64, narrow_ns: f64, amount: Amount) -> Self {
        Self { ns: [ns, narrow_ns, narrow_ns], amount }
    }
}

/// Built-in time of some work on one thread, ns.
pub(crate) fn built_in_ns(
    terms: &[CostTerm],
    stats: &SceneStats,
    has_order: bool,
    isa: Isa,
) -> f64 {
    terms.iter().map(|term| (term.amount)(stats, has_order) * term.ns[isa as usize]).sum()
}

/// Boxes whose keys and order the caches of one core hold.
const CACHED_BOXES: f64 = 65_536.0;

/// Boxes, times the doublings of the scene above what the caches hold.
pub(super) fn spills(stats: &SceneStats) -> f64 {
    stats.boxes() * (stats.boxes() / CACHED_BOXES).max(1.0).log2()
}
