//! How many GPUs share a frame or a scene: the question of Avril et al. 2014, §6. Pure.

use pairmask_core::mask::Encoding;
use pairmask_core::plan::{GpuCost, Plan};
use pairmask_core::{BoxCount, EngineName};

/// A second wait for all GPUs, when their items are counted, ns.
const SECOND_WAIT_NS: f64 = 25_000.0;
/// To submit the two parts of a share, ns.
const SUBMIT_NS: f64 = 15_000.0;
/// A plan changes from one GPU to several where that is sooner by this share: predictions are no better.
const WORTH: f64 = 0.95;

/// Fewest boxes of a scene that all GPUs keep: each edit is brought to all of them, and a search of fewer boxes ends
/// too soon to make up for that.
const SHARED_SCENE_BOXES: usize = 1_000_000;

/// Whether all GPUs keep a scene of so many boxes.
pub(super) const fn is_scene_shared(boxes: usize) -> bool {
    boxes >= SHARED_SCENE_BOXES
}

/// How many of so many idle GPUs, each of such a cost, share a frame of this plan. All of them read all
/// boxes, each over its own link; what comes after is shared.
pub(super) fn gpus_for(plan: &Plan, cost: &GpuCost, idle: usize) -> usize {
    let is_grid = plan.engine == EngineName::GpuGrid && plan.encoding != Encoding::Dense;
    let predicted = plan.candidates.iter().flatten().find(|c| c.engine == plan.engine);
    let Some(one_ns) = predicted.filter(|_| is_grid).map(|c| c.predicted_ns - c.visit_ns) else {
        return 1;
    };
    let same_ns = cost.fixed_ns + cost.grid_fixed_ns + up_ns(cost, plan.stats.n);
    let shared_ns = (one_ns - same_ns).max(0.0);
    let ns = |gpus: usize| match gpus {
        1 => one_ns * WORTH,
        _ => same_ns + shared_ns / gpus as f64 + SECOND_WAIT_NS + SUBMIT_NS * gpus as f64,
    };
    (1..=idle.max(1)).min_by(|a, b| ns(*a).total_cmp(&ns(*b))).unwrap_or(1)
}

fn up_ns(cost: &GpuCost, n: BoxCount) -> f64 {
    cost.ns_a_box * f64::from(n.get())
}

#[cfg(test)]
mod tests {
    use pairmask_core::dispatch::CullOptions;
    use pairmask_core::engine::{AvailableIsa, EngineChoice};
    use pairmask_core::plan::{Calibration, Capabilities, SceneStats, plan};

    use super::*;

    /// What an H200 costs.
    const H200: GpuCost = GpuCost {
        fixed_ns: 25_000.0,
        ns_a_box: 0.45,
        ns_a_test: 0.001,
        grid_fixed_ns: 20_000.0,
        grid_ns_a_box: Some(0.45),
        ns_a_reply_byte: 0.02,
        ns_a_visited_byte: 0.02,
    };

    fn for_boxes(n: u32, engine: EngineName, idle: usize) -> usize {
        let options = CullOptions {
            engine: EngineChoice::Only(engine),
            last_pairs: Some(u64::from(n)),
            ..CullOptions::default()
        };
        let stats = SceneStats::unseen(BoxCount::new(n), options.last_pairs);
        let capabilities = Capabilities { threads: 16, gpu: Some(H200) };
        let calibration = Calibration::built_in(AvailableIsa::best().get());
        gpus_for(&plan(&stats, &capabilities, &calibration, &options), &H200, idle)
    }

    #[test]
    fn large_frames_are_shared_and_small_ones_are_not() {
        for n in [2, 1_000, 10_000, 50_000] {
            assert_eq!(for_boxes(n, EngineName::GpuGrid, 2), 1, "{n} boxes");
        }
        for n in [1_000_000, 10_000_000] {
            assert_eq!(for_boxes(n, EngineName::GpuGrid, 2), 2, "{n} boxes");
            assert_eq!(for_boxes(n, EngineName::GpuGrid, 1), 1, "{n} boxes");
            assert_eq!(for_boxes(n, EngineName::GpuGrid, 0), 1, "{n} boxes");
            assert!(for_boxes(n, EngineName::GpuGrid, 8) >= 2, "{n} boxes");
        }
        assert_eq!(for_boxes(1_000_000, EngineName::GpuBrute, 2), 1, "all pairs is not shared");
        assert_eq!(for_boxes(1_000_000, EngineName::CpuGrid, 2), 1);
    }
}
