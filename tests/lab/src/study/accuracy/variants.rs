//! The papers' ways to turn a pair's number into the pair (Avril et al. 2012, §3), speed against
//! error, beside the modes of the same report.
//!
//! These ways serve no client: production is exact for every n. The mapping study
//! ([`crate::study::mapping`]) has all their figures; an accuracy report shows this part.

use std::str::FromStr;

use pairmask_core::BoxCount;
use pairmaskd::execute::gpu::{Checks, GpuChoice};
use serde::{Deserialize, Serialize};

use crate::Result;
use crate::study::harness::open_if_any;
use crate::study::mapping::errors::Coverage;
use crate::study::mapping::gpu::Bench;
use crate::study::mapping::stage::Variant;
use crate::study::mapping::{
    MapTimeRow, PairErrorRow, Plan, Processor, Scope, map_times, pair_errors,
};

/// A value of `--mapping`: all, none, or the name of a way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ways(Vec<Variant>);

impl FromStr for Ways {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let is_meant = |variant: &Variant| s == "all" || variant.to_string() == s;
        let ways: Vec<Variant> = Variant::all().filter(is_meant).collect();
        if ways.is_empty() && s != "none" {
            return Err(format!(
                "'{s}' is no way to map pairs: choose all, none, or names of `mapping`, such as far-end, \
                 lazy or 'closed sqrt corrected'"
            ));
        }
        Ok(Self(ways))
    }
}

/// One way for n boxes on one processor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantRow {
    pub variant: String,
    pub n: u32,
    pub processor: String,
    pub ps_per_pair: Option<f64>,
    pub is_complete: bool,
    pub ids: u64,
    pub wrong: u64,
    pub wrong_share: f64,
    pub missed_share: [f64; 2],
    pub largest_row_error: u64,
}

/// Measures the ways that are chosen at every n of 2 boxes or more, on the CPU and on the GPU of the
/// choice, if there is one.
pub fn measure(ways: &[Ways], sizes: &[u32], gpu: &GpuChoice) -> Result<Vec<VariantRow>> {
    let variants: Vec<Variant> = Variant::all()
        .filter(|variant| ways.iter().any(|Ways(ways)| ways.contains(variant)))
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
    fn the_ways_that_are_chosen_are_measured() -> crate::Result<()> {
        let of = |name: &str| name.parse::<Ways>().unwrap_or_else(|error| panic!("{error}"));
        let ways = ["far-end", "closed carmack-1"].map(of);
        let rows = measure(&ways, &[1, 3_000], &GpuChoice::None)?;
        let [newton, exact] = &rows[..] else { panic!("{rows:?}") };
        let names = (newton.variant.as_str(), exact.variant.as_str());
        assert_eq!(names, ("closed carmack-1", "far-end"));
        assert_eq!((exact.wrong, exact.missed_share), (0, [0.0; 2]));
        // The design's measured fact: one Newton step is wrong on 80 % of the numbers.
        assert!((0.75..0.85).contains(&newton.wrong_share) && newton.missed_share[0] > 0.0);
        for row in &rows {
            assert!(row.is_complete && row.ids == 4_498_500 && row.processor == "cpu", "{row:?}");
            assert!(row.ps_per_pair.is_some_and(|ps| ps > 0.0), "{row:?}");
        }
        assert_eq!(measure(&[of("none")], &[10], &GpuChoice::None)?, []);
        assert!("closed".parse::<Ways>().is_err());
        // Errors that a sample passes over show at the ends of rows.
        let rows = measure(&[of("closed sqrt corrected")], &[100_000], &GpuChoice::None)?;
        assert!(rows[0].wrong_share > 0.0 && !rows[0].is_complete, "{rows:?}");
        assert!(rows[0].missed_share[0] <= rows[0].missed_share[1], "{rows:?}");
        Ok(())
    }
}
