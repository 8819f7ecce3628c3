//! The plan of the study, a pure function of the machine's kind.

use std::time::Duration;

use crate::study::mapping::stage::Variant;

use super::Budget;

/// Sizes and budgets of a study.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Ways to turn an id into a pair whose errors and times are measured.
    pub variants: Vec<Variant>,
    /// Numbers whose roots are compared (table 3).
    pub root_counts: Vec<u64>,
    /// Numbers of boxes of the error study.
    pub error_counts: Vec<u32>,
    /// Largest of them that is counted id by id on the CPU.
    pub exhaustive_cpu: u32,
    /// Largest of them that is counted id by id on the GPU.
    pub exhaustive_gpu: u32,
    /// Ids of a sample on the CPU.
    pub sample_ids: u64,
    /// Words of 32 ids of a sample on the GPU.
    pub sample_words: u32,
    /// Most boxes in the search for the first wrong number of boxes.
    pub first_wrong_limit: u32,
    /// Numbers of boxes whose ids are mapped by every variant, for time (the paper's table 2
    /// among them).
    pub time_counts: Vec<u32>,
    /// Numbers whose roots are timed (table 4).
    pub root_time_counts: Vec<u64>,
    /// Numbers of boxes of the output study (table 5).
    pub output_counts: Vec<u32>,
    /// Numbers of boxes of figure 4.
    pub growth_counts: Vec<u32>,
    /// Budget of each measurement on the CPU.
    pub cpu: Budget,
    /// Budget of each measurement on the GPU.
    pub gpu: Budget,
}

/// Fewest threads of a machine that counts as large.
const MANY_THREADS: usize = 8;

impl Plan {
    /// The plan for a machine. `software` means that the adapter is a software one.
    pub fn new(quick: bool, software: bool, threads: usize) -> Self {
        let tens = |from: u32, to: u32| (from..=to).map(|e| 10u64.pow(e)).collect();
        let budget = |time_ms, longest_ms, most_cpu_ids| Budget {
            time: Duration::from_millis(time_ms),
            longest_run: Duration::from_millis(longest_ms),
            most_cpu_ids,
        };
        if quick {
            return Self {
                variants: Variant::all().collect(),
                root_counts: tens(3, 5),
                error_counts: vec![1_000, 4_113, 16_384, 100_000],
                exhaustive_cpu: 1_000,
                exhaustive_gpu: 1_000,
                sample_ids: 1 << 14,
                sample_words: 1 << 9,
                first_wrong_limit: 4_200,
                time_counts: vec![1_000],
                root_time_counts: tens(6, 6),
                output_counts: vec![100, 1_000],
                growth_counts: vec![100, 500, 1_000],
                cpu: budget(1, 50, 1 << 18),
                gpu: budget(1, 50, 0),
            };
        }
        let large = threads >= MANY_THREADS;
        Self {
            variants: Variant::all().collect(),
            root_counts: tens(3, 8),
            // k leaves 2^24 at 5,794 boxes, 2^31 at 65,537 and 2^32 at 92,683.
            error_counts: vec![
                1_000, 3_000, 4_096, 4_113, 10_000, 16_384, 32_768, 65_536, 92_682, 100_000,
                300_000, 1_000_000,
            ],
            exhaustive_cpu: if large { 32_768 } else { 10_000 },
            exhaustive_gpu: if software { 1_000 } else { 92_682 },
            sample_ids: if large { 1 << 22 } else { 1 << 20 },
            sample_words: if software { 1 << 12 } else { 1 << 18 },
            first_wrong_limit: if large { 20_000 } else { 13_000 },
            time_counts: vec![1_000, 10_000, 100_000],
            root_time_counts: tens(6, 9),
            output_counts: vec![100, 1_000, 5_000, 7_500],
            growth_counts: (0..=10).map(|i| if i == 0 { 100 } else { i * 500 }).collect(),
            cpu: budget(20, 2_000, 1 << 24),
            gpu: if software { budget(20, 300, 0) } else { budget(20, 2_000, 0) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_plan_measures_something_of_everything() {
        for (quick, software, threads) in
            [(true, true, 2), (false, true, 2), (false, false, 16), (true, false, 64)]
        {
            let plan = Plan::new(quick, software, threads);
            for empty in [
                plan.variants.is_empty(),
                plan.root_counts.is_empty(),
                plan.error_counts.is_empty(),
                plan.time_counts.is_empty(),
                plan.root_time_counts.is_empty(),
                plan.output_counts.is_empty(),
                plan.growth_counts.is_empty(),
            ] {
                assert!(!empty, "{plan:?}");
            }
            assert!(plan.error_counts.is_sorted() && plan.error_counts[0] <= plan.exhaustive_gpu);
        }
    }

    #[test]
    fn a_full_study_has_the_sizes_of_the_paper() {
        let plan = Plan::new(false, false, 16);
        assert_eq!(plan.output_counts, [100, 1_000, 5_000, 7_500]);
        assert_eq!(plan.time_counts, [1_000, 10_000, 100_000]);
        assert_eq!((plan.growth_counts[0], plan.growth_counts[10]), (100, 5_000));
        assert_eq!(plan.root_counts[5], 100_000_000);
    }
}
