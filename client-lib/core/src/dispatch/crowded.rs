//! Scenes that an engine has handed over, so that it need not find out again with each frame.

use crate::backoff::Backoff;
use crate::engine::{EngineChoice, EngineName};
use crate::plan::Plan;
use crate::units::BoxCount;

/// The engine that takes a frame over: there is none that it does badly.
pub(super) const TAKES_OVER: EngineName = EngineName::CpuTree;

/// Boxes may be more or fewer by one in so many.
const ALIKE_BOXES: u32 = 8;

/// Engines, by their places, that do not get a scene for a while.
pub(super) type Barred = [bool; EngineName::ALL.len()];

/// The scene that was handed over last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crowded {
    n: BoxCount,
    /// The engines that handed it over.
    barred: Barred,
    /// Frames until these are tried again.
    backoff: Backoff,
}

impl Crowded {
    /// After a scene of `n` boxes was handed over by an engine.
    pub fn again(before: Option<Self>, n: BoxCount, by: EngineName) -> Self {
        let same = before.filter(|before| before.is_of(n));
        let (mut barred, mut backoff) =
            same.map_or((Barred::default(), Backoff::NONE), |same| (same.barred, same.backoff));
        barred[by.ordinal()] = true;
        backoff.failed();
        Self { n, barred, backoff }
    }

    fn is_of(&self, n: BoxCount) -> bool {
        n.get().abs_diff(self.n.get()) <= self.n.get() / ALIKE_BOXES
    }

    /// The engines that do not get the next frame, planned so.
    pub fn bars(&mut self, plan: &Plan) -> Barred {
        let is_its = plan.options.engine == EngineChoice::Auto && self.is_of(plan.stats.n);
        if !is_its || !self.backoff.is_waiting() {
            return Barred::default();
        }
        let mut barred = self.barred;
        if EngineName::ALL.iter().any(|engine| engine.is_gpu() && barred[engine.ordinal()]) {
            // Cores find no cells where a GPU finds none.
            barred[EngineName::CpuGrid.ordinal()] = true;
            barred[EngineName::CpuSap.ordinal()] = true;
        }
        barred
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::engine::{GpuCost, Isa};
    use crate::plan::{Calibration, Capabilities, CullOptions, SceneStats, plan};

    /// The plan of a frame of which nothing is known.
    pub(in crate::dispatch) fn planned(n: u32, choice: EngineChoice) -> Plan {
        planned_beside(n, choice, None)
    }

    /// The same, with a GPU that answers soon.
    pub(in crate::dispatch) fn planned_beside_a_gpu(n: u32) -> Plan {
        planned_beside(n, EngineChoice::Auto, Some(crate::plan::tests::GPU))
    }

    fn planned_beside(n: u32, choice: EngineChoice, gpu: Option<GpuCost>) -> Plan {
        let stats = SceneStats::unseen(BoxCount::new(n), None);
        let options = CullOptions { engine: choice, ..CullOptions::default() };
        let capabilities = Capabilities { threads: 1, gpu };
        plan(&stats, &capabilities, &Calibration::built_in(Isa::Avx2), &options)
    }

    fn barred(engines: &[EngineName]) -> Barred {
        let mut barred = Barred::default();
        for engine in engines {
            barred[engine.ordinal()] = true;
        }
        barred
    }

    #[test]
    fn engines_that_handed_a_scene_over_are_tried_ever_more_seldom() {
        use EngineName::{CpuGrid, CpuSap};
        let n = BoxCount::new(50_000);
        let plan = planned(n.get(), EngineChoice::Auto);
        let mut crowded = Crowded::again(None, n, CpuGrid);
        assert_eq!(crowded.bars(&plan), barred(&[CpuGrid]));
        crowded = Crowded::again(Some(crowded), n, CpuSap);
        for frames in [2, 4, 8].map(|times| times * Backoff::LEAST) {
            for _ in 0..frames {
                assert_eq!(crowded.bars(&plan), barred(&[CpuGrid, CpuSap]));
            }
            assert_eq!(crowded.bars(&plan), Barred::default());
            crowded = Crowded::again(Some(crowded), n, CpuSap);
        }
    }

    #[test]
    fn cores_do_not_try_what_a_gpu_handed_over() {
        use EngineName::{CpuGrid, CpuSap, GpuGrid};
        let plan = planned(50_000, EngineChoice::Auto);
        let mut crowded = Crowded::again(None, plan.stats.n, GpuGrid);
        assert_eq!(crowded.bars(&plan), barred(&[CpuGrid, CpuSap, GpuGrid]));
    }

    #[test]
    fn other_scenes_and_forced_engines_stay() {
        let mut crowded = Crowded::again(None, BoxCount::new(50_000), EngineName::CpuGrid);
        for plan in [
            planned(60_000, EngineChoice::Auto),
            planned(50_000, EngineChoice::Only(EngineName::CpuGrid)),
        ] {
            assert_eq!(crowded.bars(&plan), Barred::default());
        }
    }
}
