//! Scenes that an engine has handed over, so that it need not find out again with each frame.

use crate::backoff::Backoff;
use crate::engine::{EngineChoice, EngineName};
use crate::plan::Plan;
use crate::units::BoxCount;

/// The engine that takes scenes over: it has none that it does badly.
pub(super) const TAKES_OVER: EngineName = EngineName::CpuTree;

/// Boxes may be more or fewer by one in so many.
const ALIKE_BOXES: u32 = 8;

/// The scene that was handed over last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crowded {
    n: BoxCount,
    /// The engine that handed it over.
    by: EngineName,
    /// Frames until the planned engine is tried again.
    backoff: Backoff,
}

impl Crowded {
    /// After a scene of `n` boxes was handed over by an engine.
    pub fn again(before: Option<Self>, n: BoxCount, by: EngineName) -> Self {
        let mut backoff = match before {
            Some(before) if before.is_of(n) => before.backoff,
            _ => Backoff::NONE,
        };
        backoff.failed();
        Self { n, by, backoff }
    }

    fn is_of(&self, n: BoxCount) -> bool {
        n.get().abs_diff(self.n.get()) <= self.n.get() / ALIKE_BOXES
    }

    /// Changes a plan to the engine that takes over, where this is its scene.
    pub fn replan(&mut self, plan: &mut Plan) {
        // A GPU may find cells where cores find none: what it hands over, they do not try.
        let is_its = plan.options.engine == EngineChoice::Auto
            && (self.by.is_gpu() || !plan.engine.is_gpu())
            && self.is_of(plan.stats.n);
        if let Some(over) = plan.candidates[TAKES_OVER.place()]
            && is_its
            && self.backoff.is_waiting()
        {
            (plan.engine, plan.encoding, plan.threads) = (over.engine, over.encoding, over.threads);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Isa;
    use crate::plan::{Calibration, Capabilities, CullOptions, SceneStats, plan};

    fn planned(n: u32, choice: EngineChoice) -> Plan {
        let stats = SceneStats::unseen(BoxCount::new(n), None);
        let options = CullOptions { engine: choice, ..CullOptions::default() };
        let capabilities = Capabilities { threads: 1, gpu: None };
        plan(&stats, &capabilities, &Calibration::built_in(Isa::Avx2), &options)
    }

    fn replanned(crowded: &mut Crowded, plan: &Plan) -> Plan {
        let mut plan = *plan;
        crowded.replan(&mut plan);
        plan
    }

    #[test]
    fn a_crowded_scene_goes_to_the_tree_and_the_engine_is_tried_ever_more_seldom() {
        let n = BoxCount::new(50_000);
        let chosen = planned(n.get(), EngineChoice::Auto);
        assert_eq!(chosen.engine, EngineName::CpuGrid);
        let mut crowded = Crowded::again(None, n, chosen.engine);
        for frames in [1, 2, 4].map(|times| times * Backoff::LEAST) {
            for _ in 0..frames {
                assert_eq!(replanned(&mut crowded, &chosen).engine, TAKES_OVER);
            }
            assert_eq!(replanned(&mut crowded, &chosen), chosen);
            crowded = Crowded::again(Some(crowded), n, chosen.engine);
        }
    }

    #[test]
    fn other_scenes_and_forced_engines_stay() {
        let mut crowded = Crowded::again(None, BoxCount::new(50_000), EngineName::CpuGrid);
        let larger = planned(60_000, EngineChoice::Auto);
        assert_eq!(replanned(&mut crowded, &larger), larger);
        let forced = planned(50_000, EngineChoice::Only(EngineName::CpuSap));
        assert_eq!(replanned(&mut crowded, &forced), forced);
    }
}
