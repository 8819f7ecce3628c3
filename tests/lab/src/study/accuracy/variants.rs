//! The papers' ways to turn a pair's number into the pair (Avril et al. 2012, §3), speed against
//! error, beside the modes of the same report.
//!
//! These ways serve no client: production is exact for every n. The mapping study
//! ([`crate::study::mapping`]) has all their figures; an accuracy report shows this part.

use std::fmt;
use std::str::FromStr;

use pairmask_core::BoxCount;
use pairmaskd::execute::gpu::{Checks, GpuChoice};
use serde::{Deserialize, Serialize};

use crate::study::harness::{StudyError, open_if_any};
use crate::study::mapping::errors::Coverage;
use crate::study::mapping::gpu::Bench;
use crate::study::mapping::stage::Variant;
use crate::study::mapping::{
    MapTimeRow, PairErrorRow, Plan, Processor, Scope, map_times, pair_errors,
};

/// A value of `--mapping`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VariantChoice {
    /// Every way.
    All,
    /// No way.
    None,
    /// One way.
    Only(Variant),
}

impl VariantChoice {
    fn has(self, variant: Variant) -> bool {
        self == Self::All || self == Self::Only(variant)
    }
}

impl fmt::Display for VariantChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::None => f.write_str("none"),
            Self::Only(variant) => variant.fmt(f),
        }
    }
}

/// A name that is no way.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' is no way to map pairs: choose all, none, or names of `mapping`, such as far-end, lazy or 'closed sqrt corrected'"
)]
pub struct UnknownVariant(String);

impl FromStr for VariantChoice {
    type Err = UnknownVariant;

    fn from_str(s: &str) -> Result<Self, UnknownVariant> {
        match s {
            "all" => Ok(Self::All),
            "none" => Ok(Self::None),
            _ => Variant::all()
                .find(|variant| variant.to_string() == s)
                .map(Self::Only)
                .ok_or_else(|| UnknownVariant(s.to_owned())),
        }
    }
}

/// One way for n boxes on one processor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantRow {
    /// The way.
    pub variant: String,
    /// Boxes.
    pub n: u32,
    /// `cpu` (one thread) or `gpu`.
    pub processor: String,
    /// Time a pair, picoseconds; null where the device cannot run it.
    pub ps_per_pair: Option<f64>,
    /// Whether every number was checked; else a sample, and the first and last of every row.
    pub is_complete: bool,
    /// Numbers that were checked in the sample.
    pub ids: u64,
    /// Checked numbers that become another pair, or none.
    pub wrong: u64,
    /// Share of wrong numbers; at least that of the ends of rows, where errors begin.
    pub wrong_share: f64,
    /// Bounds of the share of pairs that no number becomes: least and greatest.
    pub missed_share: [f64; 2],
    /// Largest distance of a wrong row from its own.
    pub largest_row_error: u64,
}

/// Measures the ways that are chosen at every n of 2 boxes or more, on the CPU and on the GPU of the
/// choice, if there is one.
///
/// # Errors
/// [`StudyError`].
pub fn measure(
    choices: &[VariantChoice],
    sizes: &[u32],
    gpu: &GpuChoice,
) -> Result<Vec<VariantRow>, StudyError> {
    let variants: Vec<Variant> = Variant::all()
        .filter(|variant| choices.iter().any(|choice| choice.has(*variant)))
        .collect();
    let sizes: Vec<u32> = sizes.iter().copied().filter(|n| *n >= 2).collect();
    if variants.is_empty() || sizes.is_empty() {
        return Ok(Vec::new());
    }
    let gpu = open_if_any(gpu)?;
    let is_software = gpu.as_ref().is_some_and(|gpu| gpu.info().is_software());
    let mut bench = gpu.as_ref().map(|gpu| Bench::new(gpu, Checks::Off)).transpose()?;
    let plan = Plan {
        variants,
        error_counts: sizes.clone(),
        time_counts: sizes,
        ..Plan::new(false, is_software, rayon::current_num_threads())
    };
    let errors = pair_errors(&plan, bench.as_mut())?;
    let times = map_times(&plan, bench.as_mut())?;
    Ok(errors.iter().map(|error| row(error, &times)).collect())
}

/// A row of the report from one of errors and the times.
fn row(error: &PairErrorRow, times: &[MapTimeRow]) -> VariantRow {
    let PairErrorRow { processor, variant, n, scope, tally, coverage, row_ends, .. } = *error;
    // Errors are the same on all threads; the time on one thread is the cost of the arithmetic.
    let timed_on = if processor == Processor::Gpu { Processor::Gpu } else { Processor::CpuThread };
    let is_its = |t: &&MapTimeRow| (t.processor, t.variant, t.n) == (timed_on, variant, n);
    let time = times.iter().find(is_its);
    let at_row_ends = row_ends
        .map_or(0.0, |ends| ends.wrong as f64 / BoxCount::new(n).pair_count().max(1) as f64);
    let missed_share = match coverage {
        Coverage::Counted { missed, .. } => [missed; 2],
        Coverage::Bounded { missed_least, missed_most, .. } => {
            [missed_least, missed_most.max(at_row_ends)]
        }
    };
    VariantRow {
        variant: variant.to_string(),
        n,
        processor: if timed_on == Processor::Gpu { "gpu" } else { "cpu" }.to_owned(),
        ps_per_pair: time.and_then(MapTimeRow::ps_per_pair),
        is_complete: scope == Scope::All,
        ids: tally.ids - tally.skipped,
        wrong: tally.wrong,
        wrong_share: tally.wrong_share().max(at_row_ends),
        missed_share,
        largest_row_error: error.row_error,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A row with a number everywhere.
    pub fn row(variant: &str, ps_per_pair: f64, wrong_share: f64) -> VariantRow {
        VariantRow {
            variant: variant.to_owned(),
            n: 1000,
            processor: "cpu".to_owned(),
            ps_per_pair: Some(ps_per_pair),
            is_complete: true,
            ids: 499_500,
            wrong: (499_500.0 * wrong_share) as u64,
            wrong_share,
            missed_share: [wrong_share; 2],
            largest_row_error: 1,
        }
    }

    #[test]
    fn the_ways_that_are_chosen_are_measured() -> Result<(), StudyError> {
        let choices = ["far-end", "closed carmack-1"].map(str::parse);
        let choices: Vec<VariantChoice> = choices.into_iter().filter_map(Result::ok).collect();
        let rows = measure(&choices, &[1, 3_000], &GpuChoice::None)?;
        let [newton, exact] = &rows[..] else { panic!("{rows:?}") };
        assert_eq!(
            (newton.variant.as_str(), exact.variant.as_str()),
            ("closed carmack-1", "far-end")
        );
        assert_eq!((exact.wrong, exact.missed_share), (0, [0.0; 2]));
        // The design's measured fact: one Newton step is wrong on 80 % of the numbers.
        assert!((0.75..0.85).contains(&newton.wrong_share) && newton.missed_share[0] > 0.0);
        for row in &rows {
            assert!(row.is_complete && row.ids == 4_498_500 && row.processor == "cpu", "{row:?}");
            assert!(row.ps_per_pair.is_some_and(|ps| ps > 0.0), "{row:?}");
        }
        assert_eq!(measure(&[VariantChoice::None], &[10], &GpuChoice::None)?, []);
        Ok(())
    }

    #[test]
    fn errors_that_a_sample_passes_over_show_at_the_ends_of_rows() -> Result<(), StudyError> {
        let choice =
            VariantChoice::from_str("closed sqrt corrected").unwrap_or(VariantChoice::None);
        let rows = measure(&[choice], &[100_000], &GpuChoice::None)?;
        assert!(rows[0].wrong_share > 0.0 && !rows[0].is_complete, "{rows:?}");
        assert!(rows[0].missed_share[0] <= rows[0].missed_share[1], "{rows:?}");
        Ok(())
    }

    #[test]
    fn names_parse_back() {
        for choice in Variant::all().map(VariantChoice::Only).chain([VariantChoice::All]) {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        assert!("closed".parse::<VariantChoice>().is_err());
    }
}
