//! The plan of a scene's last frames, taken again while the scene is about the same.
//!
//! A look at the boxes and the prices of all ways take 0.5 µs at 64 boxes and 20 at 4,096, a fifth of such
//! frames. What they show changes little from frame to frame.

use super::{Capabilities, CullOptions, Plan, SceneStats};
use crate::units::BoxCount;

/// Boxes may be more or fewer by one in so many.
const ALIKE_BOXES: u32 = 32;
/// Pairs may be more or fewer by one in so many.
const ALIKE_PAIRS: u64 = 8;
/// And by so many in any case: few pairs have no say in a choice.
const FEW_PAIRS: u64 = 64;
/// Plans that are kept: a frame may be planned with all threads and with one, with a GPU and without.
const KEPT: usize = 4;

/// The plans of one scene's last frames.
#[derive(Clone, Debug, Default)]
pub struct PlanMemory {
    kept: [Option<Kept>; KEPT],
    /// The one that is replaced next.
    oldest: usize,
}

#[derive(Clone, Debug)]
struct Kept {
    plan: Plan,
    capabilities: Capabilities,
    frames_left: u32,
}

impl PlanMemory {
    /// Frames for which a plan is taken. Planning then takes a sixteenth of its time or less, and a scene
    /// that loosens or crowds is seen after as many frames.
    pub const FRAMES: u32 = 16;

    /// The plan of an earlier frame, where this one is about the same: as many boxes and pairs or nearly
    /// so, and the same options and capabilities.
    pub fn again(
        &mut self,
        n: BoxCount,
        capabilities: &Capabilities,
        options: &CullOptions,
    ) -> Option<Plan> {
        let kept = self.kept.iter_mut().flatten();
        let kept = kept.filter(|kept| kept.frames_left > 0);
        let mut fitting = kept.filter(|kept| kept.is_for(n, capabilities, options));
        let kept = fitting.next()?;
        kept.frames_left -= 1;
        let stats = SceneStats { n, ..kept.plan.stats };
        Some(Plan { options: *options, stats, ..kept.plan })
    }

    /// Keeps a plan for the frames to come.
    pub fn keep(&mut self, plan: &Plan, capabilities: &Capabilities) {
        let alike = |kept: &Option<Kept>| {
            kept.as_ref().is_none_or(|kept| {
                asked(&kept.plan.options) == asked(&plan.options)
                    && kept.capabilities.gpu.is_some() == capabilities.gpu.is_some()
            })
        };
        let at = self.kept.iter().position(alike).unwrap_or(self.oldest);
        self.oldest = (at + 1) % KEPT;
        self.kept[at] =
            Some(Kept { plan: *plan, capabilities: *capabilities, frames_left: Self::FRAMES - 1 });
    }
}

impl Kept {
    fn is_for(&self, n: BoxCount, capabilities: &Capabilities, options: &CullOptions) -> bool {
        let Plan { stats, options: known, .. } = &self.plan;
        let boxes = stats.n.get();
        let pairs = match (known.last_pairs, options.last_pairs) {
            (Some(known), Some(last)) => {
                known.abs_diff(last) <= (known / ALIKE_PAIRS).max(FEW_PAIRS)
            }
            (known, last) => known == last,
        };
        pairs
            && n.get().abs_diff(boxes) <= boxes / ALIKE_BOXES
            && asked(known) == asked(options)
            && self.capabilities == *capabilities
    }
}

/// What a client asks for, without what is known of its last frame.
fn asked(options: &CullOptions) -> CullOptions {
    CullOptions { last_pairs: None, ..*options }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Isa;
    use crate::plan::{Calibration, plan};

    const CAPABILITIES: Capabilities = Capabilities { threads: 2, gpu: None };

    fn options(last_pairs: u64) -> CullOptions {
        CullOptions { last_pairs: Some(last_pairs), ..CullOptions::default() }
    }

    fn planned(n: u32, options: &CullOptions) -> Plan {
        let stats = SceneStats::unseen(BoxCount::new(n), options.last_pairs);
        plan(&stats, &CAPABILITIES, &Calibration::built_in(Isa::Avx512), options)
    }

    fn of(n: u32, options: &CullOptions) -> PlanMemory {
        let mut memory = PlanMemory::default();
        memory.keep(&planned(n, options), &CAPABILITIES);
        memory
    }

    #[test]
    fn a_plan_is_taken_again_for_so_many_frames() {
        let mut memory = of(1_000, &options(900));
        let mut again = || memory.again(BoxCount::new(1_000), &CAPABILITIES, &options(900));
        for _ in 1..PlanMemory::FRAMES {
            assert_eq!(again(), Some(planned(1_000, &options(900))));
        }
        assert_eq!(again(), None);
    }

    #[test]
    fn another_scene_is_planned_anew() {
        let again = |n: u32, last_pairs, capabilities| {
            let mut memory = of(1_000, &options(8_000));
            memory.again(BoxCount::new(n), &capabilities, &options(last_pairs)).is_some()
        };
        for (n, pairs) in [(1_000, 8_000), (1_031, 8_000), (969, 9_000), (1_000, 7_000)] {
            assert!(again(n, pairs, CAPABILITIES), "{n} {pairs}");
        }
        for (n, pairs) in [(1_032, 8_000), (968, 8_000), (0, 8_000), (1_000, 9_001), (1_000, 6_999)]
        {
            assert!(!again(n, pairs, CAPABILITIES), "{n} {pairs}");
        }
        assert!(!again(1_000, 8_000, Capabilities { threads: 1, ..CAPABILITIES }));
        let mut memory = of(1_000, &CullOptions::default());
        assert!(memory.again(BoxCount::new(1_000), &CAPABILITIES, &options(0)).is_none());
    }

    #[test]
    fn plans_of_other_options_stand_side_by_side() {
        let requested = [None, Some(1), Some(2), Some(3), Some(4)];
        let [wide, narrow, third, fourth, fifth] =
            requested.map(|threads| CullOptions { threads, ..options(900) });
        let n = BoxCount::new(1_000);
        let mut memory = of(1_000, &wide);
        memory.keep(&planned(1_000, &narrow), &CAPABILITIES);
        for options in [&wide, &narrow] {
            let plan = memory.again(n, &CAPABILITIES, options).expect("kept");
            assert_eq!(plan.options, *options);
        }
        for options in [&third, &fourth, &fifth] {
            memory.keep(&planned(1_000, options), &CAPABILITIES);
        }
        assert!(memory.again(n, &CAPABILITIES, &wide).is_none(), "the oldest went");
        assert!(memory.again(n, &CAPABILITIES, &narrow).is_some());
    }
}
