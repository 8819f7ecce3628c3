//! Times by the GPU's clock: ids mapped, roots taken.

use std::time::{Duration, Instant};

use pairmaskd::execute::gpu::GpuError;

use super::{Bench, WORD_IDS};
use crate::study::mapping::Budget;
use crate::study::mapping::layouts::{MappingTimeParams, RootParams};
use crate::study::mapping::stage::{IdWidth, MappingStage, Root, Variant};

/// A sum that no thread is expected to have.
const NEVER: u32 = 0xdead_beef;

/// Time to map every id of `n` boxes, in ms. `None` where they do not fit the device.
///
/// # Errors
/// [`GpuError`].
pub fn map_all(
    bench: &mut Bench,
    variant: Variant,
    n: u32,
    budget: &Budget,
) -> Result<Option<f64>, GpuError> {
    let words = variant.id_count(n).div_ceil(WORD_IDS);
    if !bench.fits(variant, n) || words == 0 {
        return Ok(None);
    }
    let Some(groups) = bench.groups(words) else { return Ok(None) };
    let stage = MappingStage::Time(variant, IdWidth::of(variant, n));
    let sized = |groups: [u32; 2], words: u64| MappingTimeParams {
        n,
        word_count: words as u32,
        groups_x: groups[0],
        never: NEVER,
    };
    timed(bench, stage, words, groups, budget, &sized)
}

/// Time to take the roots of 1 to `numbers`, in ms.
///
/// # Errors
/// [`GpuError`].
pub fn roots(
    bench: &mut Bench,
    root: Root,
    numbers: u32,
    budget: &Budget,
) -> Result<Option<f64>, GpuError> {
    let words = u64::from(numbers).div_ceil(WORD_IDS);
    let Some(groups) = bench.groups(words) else { return Ok(None) };
    let sized = |groups: [u32; 2], words: u64| RootParams {
        count: numbers,
        word_count: words as u32,
        groups_x: groups[0],
        never: NEVER,
    };
    timed(bench, MappingStage::RootTime(root), words, groups, budget, &sized)
}

/// Words of a trial run, from which it is estimated whether the whole run fits the budget.
const TRIAL_WORDS: u64 = 1 << 15;

/// Median time of a stage; `None` when it would take longer than the budget allows.
fn timed<P: bytemuck::Pod>(
    bench: &mut Bench,
    stage: MappingStage,
    words: u64,
    groups: [u32; 2],
    budget: &Budget,
    params: &dyn Fn([u32; 2], u64) -> P,
) -> Result<Option<f64>, GpuError> {
    let sink = bench.video(4)?;
    if words > TRIAL_WORDS
        && let Some(groups) = bench.groups(TRIAL_WORDS)
    {
        let step = bench.command(stage, &[&sink], &params(groups, TRIAL_WORDS), groups)?;
        let mut trial = bench.frame(vec![step])?;
        // The first run compiles and wakes the device.
        bench.run(&mut trial)?;
        let ns: f64 = bench.run(&mut trial)?.iter().map(|step| step.ns).sum();
        let expected_s = ns * 1e-9 * (words as f64 / TRIAL_WORDS as f64);
        if expected_s > budget.longest_run.as_secs_f64() {
            return Ok(None);
        }
    }
    let step = bench.command(stage, &[&sink], &params(groups, words), groups)?;
    let mut frame = bench.frame(vec![step])?;
    let ms = || Ok(bench.run(&mut frame)?.iter().map(|step| step.ns).sum::<f64>() * 1e-6);
    median_ms(budget, ms).map(Some)
}

/// Median of as many runs as the budget has time for, after one that is not counted; at least
/// three, fewer only if one run is longer than the budget.
pub(super) fn median_ms(
    budget: &Budget,
    mut run: impl FnMut() -> Result<f64, GpuError>,
) -> Result<f64, GpuError> {
    const LEAST: usize = 3;
    let started = Instant::now();
    let mut times = vec![run()?];
    let first: Duration = started.elapsed();
    if first < budget.time {
        times.clear();
        while times.len() < LEAST || started.elapsed() < budget.time {
            times.push(run()?);
        }
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
