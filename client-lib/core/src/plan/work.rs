//! What a frame takes, counted in units that one constant each gives a time.
//!
//! The cost model is a sum of products: a count of this module times a constant of the
//! [`Calibration`](super::Calibration). A fit may therefore solve for all constants at once, and
//! cannot drift from what the plan computes.

use super::term::{Side, Term};
use crate::engine::{EngineName, MaskWork, encoding_cost};
use crate::mask::Encoding;
use crate::stats::SceneStats;

/// Most terms of an engine, or of one side of an encoding.
const MOST_TERMS: usize = 8;

/// The time of an engine from boxes to mask on one thread, ns; `None` for a GPU's. As [`Work::of`] has
/// it, without the terms of all others: plans of small scenes count every ns.
pub(super) fn cull_ns(
    engine: EngineName,
    encoding: Encoding,
    stats: &SceneStats,
    constants: &[f64; Term::ALL.len()],
) -> Option<f64> {
    let cpu = engine.descriptor().cpu()?;
    let mut amounts = [0.0; MOST_TERMS];
    let amounts = &mut amounts[..cpu.terms.len()];
    (cpu.work)(stats, amounts);
    let engine_ns = dot(amounts, &constants[Term::first_of(engine)..]);
    Some(engine_ns + mask_ns(engine, encoding, Side::Write, stats, constants))
}

/// The time of one side with a mask of an engine, on one thread, ns.
pub(super) fn mask_ns(
    engine: EngineName,
    encoding: Encoding,
    side: Side,
    stats: &SceneStats,
    constants: &[f64; Term::ALL.len()],
) -> f64 {
    let mask = mask_work(encoding, side);
    let mut amounts = [0.0; MOST_TERMS];
    let amounts = &mut amounts[..mask.terms.len()];
    (mask.amounts)(stats, engine.descriptor().has_order, amounts);
    dot(amounts, &constants[Term::first_of_mask(encoding, side)..])
}

const fn mask_work(encoding: Encoding, side: Side) -> &'static MaskWork {
    let cost = encoding_cost(encoding);
    match side {
        Side::Write => &cost.write,
        Side::Visit => &cost.visit,
    }
}

fn dot(amounts: &[f64], constants: &[f64]) -> f64 {
    amounts.iter().zip(constants).map(|(amount, ns)| amount * ns).sum()
}

/// How much of each [`Term`] a part of a frame holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Work {
    amounts: [f64; Term::ALL.len()],
}

impl Work {
    /// The work of a CPU engine, from boxes to mask; `None` for a GPU's.
    pub fn of(engine: EngineName, encoding: Encoding, stats: &SceneStats) -> Option<Self> {
        let descriptor = engine.descriptor();
        let cpu = descriptor.cpu()?;
        let mut work = Self::of_mask(encoding, Side::Write, stats, descriptor.has_order);
        let (first, len) = (Term::first_of(engine), cpu.terms.len());
        (cpu.work)(stats, &mut work.amounts[first..first + len]);
        Some(work)
    }

    /// The work of a client that visits every pair of an engine's mask.
    pub fn of_visit(engine: EngineName, encoding: Encoding, stats: &SceneStats) -> Self {
        Self::of_mask(encoding, Side::Visit, stats, engine.descriptor().has_order)
    }

    /// The mask alone, of an engine that has an order of its own or keeps the boxes'.
    fn of_mask(encoding: Encoding, side: Side, stats: &SceneStats, has_order: bool) -> Self {
        let mask = mask_work(encoding, side);
        let mut amounts = [0.0; Term::ALL.len()];
        let (first, len) = (Term::first_of_mask(encoding, side), mask.terms.len());
        (mask.amounts)(stats, has_order, &mut amounts[first..first + len]);
        Self { amounts }
    }

    /// The sum of all amounts, each times the constant at its place.
    pub fn times(&self, constants: &[f64; Term::ALL.len()]) -> f64 {
        dot(&self.amounts, constants)
    }

    /// How much of one term.
    pub const fn amount(&self, term: Term) -> f64 {
        self.amounts[term.index()]
    }

    /// All amounts, in the order of [`Term::ALL`].
    pub const fn amounts(&self) -> &[f64; Term::ALL.len()] {
        &self.amounts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_term_is_work_of_some_engine_and_none_is_negative() {
        let mut seen = [false; Term::ALL.len()];
        for n in [0, 10, 1_000, 1_000_000] {
            let stats = SceneStats {
                solid_share: 1.0,
                median_size: 1.0,
                large_size: 100.0,
                elongation: 50.0,
                ..SceneStats::unseen(crate::units::BoxCount::new(n), None)
            };
            for engine in EngineName::ALL {
                for encoding in Encoding::ALL {
                    let cull = Work::of(engine, encoding, &stats);
                    assert_eq!(cull.is_none(), engine.is_gpu());
                    let visit = Work::of_visit(engine, encoding, &stats);
                    let ns = Term::ALL.map(|term| 1.0 + term.index() as f64);
                    let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs();
                    let short = cull_ns(engine, encoding, &stats, &ns);
                    assert!(near(short.unwrap_or(0.0), cull.map_or(0.0, |work| work.times(&ns))));
                    let short = mask_ns(engine, encoding, Side::Visit, &stats, &ns);
                    assert!(near(short, visit.times(&ns)), "{engine} {encoding}");
                    for work in cull.iter().chain([&visit]) {
                        for (seen, amount) in seen.iter_mut().zip(work.amounts()) {
                            assert!(amount.is_finite() && *amount >= 0.0, "{engine} {n}");
                            *seen |= *amount > 0.0;
                        }
                    }
                }
            }
        }
        assert_eq!(seen, [true; Term::ALL.len()]);
    }
}
