//! What frames took beside what the plan expected, so that no machine needs constants of its own.
//!
//! A factor for each engine and size class follows measured by predicted time slowly. Now and then a frame goes to an
//! engine that is expected to be nearly as fast as the planned one, so that its factor is known too. The pairs are the
//! same whichever engine finds them.

use super::crowded::Barred;
use crate::engine::{EngineChoice, EngineName};
use crate::plan::{Candidate, Plan};
use crate::units::BoxCount;

/// Frames between two looks at another engine: each of them may take half as long again. A session's first looks are
/// sooner: at its frames 8, 16 and 32.
const LOOK_FRAMES: u32 = 64;
const FIRST_LOOK: u32 = 8;
/// Engines that are expected to take longer than the planned one by more than this are not looked at.
const LOOK_WITHIN: f64 = 1.5;
/// An engine takes the planned one's place where it is expected to be so much sooner: less is noise.
const SOONER: f64 = 0.9;
/// Part of the way that a factor goes to what a frame took.
const WEIGHT: f64 = 0.125;
/// A frame counts as if it took at most so many times its expected time, or so little of it: most that take longer were
/// interrupted.
const FARTHEST: f64 = 2.0;
/// What was learned of engines that do not run fades by this with each look, so that they are looked at again: what held
/// them up may no longer exist.
const KEPT: f64 = 0.9;
/// Size classes, each of four times as many boxes as the one before.
const CLASSES: usize = 17;

/// Factors of engines.
#[derive(Clone, Debug, Default)]
pub(super) struct Learned {
    /// By the places of engines.
    factors: [[Factor; CLASSES]; EngineName::ALL.len()],
    frames: u32,
}

/// What is known of measured by predicted time.
#[derive(Clone, Copy, Debug)]
struct Factor {
    /// Its logarithm, 0 where nothing is known.
    ln: f64,
    /// The factor itself: plans of small scenes count every ns, and each looks at those of all engines.
    times: f64,
    is_known: bool,
    /// Whether the engine has had a frame.
    is_warm: bool,
}

impl Default for Factor {
    fn default() -> Self {
        Self { ln: 0.0, times: 1.0, is_known: false, is_warm: false }
    }
}

impl Factor {
    fn set(&mut self, ln: f64) {
        (self.ln, self.times) = (ln, ln.exp());
    }
}

fn class_of(n: BoxCount) -> usize {
    ((n.get().max(1).ilog2() / 2) as usize).min(CLASSES - 1)
}

impl Learned {
    /// An engine took so long for a frame in place of what the plan expected; as long as can be where it handed the
    /// frame over. Its first frame of a size, for which it gets memory, says nothing of others.
    pub fn note(&mut self, engine: EngineName, expected_ns: u64, n: BoxCount, measured_ns: u64) {
        self.frames = self.frames.wrapping_add(1);
        let (slot, class) = (engine.ordinal(), class_of(n));
        let is_warm = std::mem::replace(&mut self.factors[slot][class].is_warm, true);
        if expected_ns == 0 || measured_ns == 0 || !is_warm {
            return;
        }
        if self.is_look_due() {
            let others = self.factors.iter_mut().enumerate().filter(|(other, _)| *other != slot);
            others.for_each(|(_, of)| of[class].set(KEPT * of[class].ln));
        }
        let took = (measured_ns as f64 / expected_ns as f64).ln();
        let factor = &mut self.factors[slot][class];
        let step = (took - factor.ln).clamp(-FARTHEST.ln(), FARTHEST.ln());
        // The first that counts says more than nothing does.
        let weight = if factor.is_known { WEIGHT } else { 0.5 };
        factor.set(factor.ln + weight * step);
        factor.is_known = true;
    }

    /// The engine that is soonest by what was learned takes the planned one's place, or the one to be looked at; none
    /// that is barred.
    pub fn replan(&self, plan: &mut Plan, barred: Barred) {
        if plan.options.engine != EngineChoice::Auto {
            return;
        }
        let class = class_of(plan.stats.n);
        let factor = |engine: EngineName| self.factors[engine.ordinal()][class];
        let expected_ns = EngineName::ALL.map(|engine| {
            plan.candidates[engine.ordinal()].map_or(f64::INFINITY, |c| {
                let engine_ns = c.predicted_ns - c.iterate_ns;
                engine_ns * factor(engine).times + c.iterate_ns
            })
        });
        let expected = |c: &Candidate| expected_ns[c.engine.ordinal()];
        let soonest = |among: &mut dyn Iterator<Item = Candidate>| {
            among.min_by(|a, b| expected(a).total_cmp(&expected(b)))
        };
        let may_be = |c: &Candidate| !barred[c.engine.ordinal()];
        let candidates = || plan.candidates.iter().flatten().copied().filter(may_be);
        let planned = candidates().find(|c| c.engine == plan.engine);
        let most_ns = planned.map_or(f64::INFINITY, |planned| SOONER * expected(&planned));
        let best = soonest(&mut candidates().filter(|c| expected(c) < most_ns));
        let Some(mut chosen) = best.or(planned) else { return };
        if self.is_look_due() {
            let most_ns = LOOK_WITHIN * expected(&chosen);
            let near = |c: &Candidate| {
                c.engine != chosen.engine && !c.engine.is_gpu() && expected(c) <= most_ns
            };
            let unseen =
                soonest(&mut candidates().filter(|c| near(c) && !factor(c.engine).is_known));
            chosen = unseen.or_else(|| soonest(&mut candidates().filter(near))).unwrap_or(chosen);
        }
        (plan.engine, plan.encoding, plan.threads) =
            (chosen.engine, chosen.encoding, chosen.threads);
    }

    fn is_look_due(&self) -> bool {
        let is_first = self.frames >= FIRST_LOOK && self.frames.is_power_of_two();
        is_first || self.frames > 0 && self.frames.is_multiple_of(LOOK_FRAMES)
    }
}

#[cfg(test)]
mod tests {
    use super::super::crowded::tests::planned;
    use super::*;

    /// Frames of a machine where engines take some factor of what is expected. Returns the engines of the last ones.
    fn frames(
        learned: &mut Learned,
        plan: &Plan,
        count: u32,
        factor: impl Fn(EngineName) -> f64,
    ) -> Vec<EngineName> {
        let mut engines = Vec::new();
        for _ in 0..count {
            let mut replanned = *plan;
            learned.replan(&mut replanned, Barred::default());
            let (engine, expected_ns) = (replanned.engine, replanned.expected_ns());
            let took = (expected_ns as f64 * factor(engine)) as u64;
            learned.note(engine, expected_ns, replanned.stats.n, took);
            engines.push(engine);
        }
        engines
    }

    fn count_of(engines: &[EngineName], engine: EngineName) -> usize {
        engines.iter().filter(|e| **e == engine).count()
    }

    #[test]
    fn a_machine_as_expected_keeps_the_plan_and_looks_seldom() {
        for n in [64, 1_000, 50_000] {
            let plan = planned(n, EngineChoice::Auto);
            let engines = frames(&mut Learned::default(), &plan, 1_000, |_| 1.0);
            assert!(count_of(&engines, plan.engine) >= 980, "{n}");
        }
    }

    #[test]
    fn an_engine_that_is_slower_here_is_replaced_and_comes_back() {
        let plan = planned(1_000, EngineChoice::Auto);
        let mut learned = Learned::default();
        let slow = |engine| if engine == plan.engine { 3.0 } else { 1.0 };
        let engines = frames(&mut learned, &plan, 50, slow);
        assert_ne!(engines[49], plan.engine);
        let engines = frames(&mut learned, &plan, 2_000, |_| 1.0);
        assert_eq!(engines[1_990], plan.engine, "by looks, its factor is 1 again");
    }

    #[test]
    fn other_sizes_and_asked_engines_are_as_planned() {
        let plan = planned(1_000, EngineChoice::Auto);
        let mut learned = Learned::default();
        frames(&mut learned, &plan, 60, |engine| if engine == plan.engine { 3.0 } else { 1.0 });
        for other in
            [planned(50_000, EngineChoice::Auto), planned(1_000, EngineChoice::Only(plan.engine))]
        {
            let mut replanned = other;
            learned.replan(&mut replanned, Barred::default());
            assert_eq!(replanned, other);
        }
    }

    #[test]
    fn a_barred_engine_gives_way_to_the_next() {
        let plan = planned(1_000, EngineChoice::Auto);
        let mut barred = Barred::default();
        barred[plan.engine.ordinal()] = true;
        let mut replanned = plan;
        Learned::default().replan(&mut replanned, barred);
        let others = plan.candidates.iter().flatten().filter(|c| c.engine != plan.engine);
        let next = others.min_by(|a, b| a.predicted_ns.total_cmp(&b.predicted_ns));
        assert_eq!(next.map(|next| next.engine), Some(replanned.engine));
    }

    #[test]
    fn a_gpu_that_is_slower_here_gives_way_to_cores_but_not_for_its_first_frame() {
        let plan = crate::dispatch::crowded::tests::planned_beside_a_gpu(3_000);
        assert!(plan.engine.is_gpu());
        for (slower, stays) in [(1, true), (6, false)] {
            let mut learned = Learned::default();
            for frame in 0..30 {
                let mut replanned = plan;
                learned.replan(&mut replanned, Barred::default());
                let (engine, expected_ns) = (replanned.engine, replanned.expected_ns());
                let factor = if frame == 0 { 100 } else { slower };
                let factor = if engine.is_gpu() { factor } else { 1 };
                learned.note(engine, expected_ns, plan.stats.n, factor * expected_ns);
            }
            let mut replanned = plan;
            learned.replan(&mut replanned, Barred::default());
            assert_eq!(replanned.engine.is_gpu(), stays, "{slower}");
        }
    }

    #[test]
    fn one_interrupted_frame_changes_nothing() {
        let plan = planned(1_000, EngineChoice::Auto);
        let mut learned = Learned::default();
        frames(&mut learned, &plan, 33, |_| 1.0);
        frames(&mut learned, &plan, 1, |_| 1_000.0);
        assert_eq!(frames(&mut learned, &plan, 1, |_| 1.0), [plan.engine]);
    }
}
