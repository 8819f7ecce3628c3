//! The error study on a device: the same counts as [`crate::study::mapping::errors`], by the
//! device's own arithmetic.

use pairmaskd::execute::gpu::{Block, Command, GpuError, Part};

use super::{Bench, WORD_IDS, zeroed};
use crate::study::mapping::errors::{Coverage, Tally, counted};
use crate::study::mapping::layouts::{MappingErrorsParams, MappingTally, RootParams, RootTally};
use crate::study::mapping::root_errors;
use crate::study::mapping::stage::{IdWidth, MappingStage, Root, Variant};

/// The ids of a variant that are checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ids {
    /// All of them.
    All,
    /// Words of 32 ids, as many as given, evenly apart.
    Words(u32),
    /// Sixteen ids on either side of the start of each row.
    AroundRows,
}

/// Counts the wrong ids. `None` where the ids do not fit the device's integers, counters or
/// dispatches.
///
/// # Errors
/// [`GpuError`].
pub fn count(
    bench: &mut Bench,
    variant: Variant,
    n: u32,
    ids: Ids,
) -> Result<Option<(Tally, Coverage)>, GpuError> {
    let total = variant.id_count(n);
    // The device counts in 32 bits.
    let too_many = ids == Ids::All && u32::try_from(total).is_err();
    if total == 0 || too_many || !bench.fits(variant, n) {
        return Ok(None);
    }
    let (words, stride, around_rows) = match ids {
        Ids::All => (total.div_ceil(WORD_IDS), WORD_IDS, 0),
        Ids::Words(words) => {
            let words = u64::from(words).min(total.div_ceil(WORD_IDS)).max(1);
            (words, (total / words).max(WORD_IDS), 0)
        }
        Ids::AroundRows => (u64::from(n) - 1, 0, 1),
    };
    let pairs = u64::from(n) * (u64::from(n) - 1) / 2;
    let map_bytes = pairs.div_ceil(32) * 4;
    let mark = ids == Ids::All
        && u32::try_from(pairs).is_ok()
        && map_bytes <= bench.gpu().limits().storage_binding_bytes;
    let Some(groups) = bench.groups(words) else { return Ok(None) };
    let params = MappingErrorsParams {
        n,
        word_count: words as u32,
        groups_x: groups[0],
        around_rows,
        stride_low: stride as u32,
        stride_high: (stride >> 32) as u32,
        mark: u32::from(mark),
        ..MappingErrorsParams::default()
    };
    let tally = bench.host(size_of::<MappingTally>() as u64)?;
    tally.write(0, &[MappingTally::default()]);
    let named = bench.video(if mark { map_bytes } else { 4 })?;
    let stage = MappingStage::Errors(variant, IdWidth::of(variant, n));
    let mut steps = clear(bench, &named)?;
    steps.push(bench.command(stage, &[&tally, &named], &params, groups)?);
    let mut frame = bench.frame(steps)?;
    bench.run(&mut frame)?;
    let mut counts: [MappingTally; 1] = [MappingTally::default()];
    tally.read(0, &mut counts);
    let MappingTally { ids, skipped, wrong, wrong_named, row_error, distinct } = counts[0];
    let tally = Tally {
        ids: u64::from(ids),
        skipped: u64::from(skipped),
        wrong: u64::from(wrong),
        wrong_named: u64::from(wrong_named),
        largest_row_error: u64::from(row_error),
        first_wrong: None,
    };
    let coverage =
        if mark { counted(&tally, pairs, u64::from(distinct)) } else { Coverage::bounded(&tally) };
    Ok(Some((tally, coverage)))
}

/// Bytes that one copy clears.
const CLEAR_BYTES: u64 = 32 << 20;

/// Steps that zero a block.
fn clear(bench: &Bench, block: &std::sync::Arc<Block>) -> Result<Vec<Command>, GpuError> {
    let bytes = block.bytes().min(CLEAR_BYTES);
    let zeros = bench.host(bytes)?;
    zeros.write(0, &zeroed::<u8>(bytes as usize));
    let chunks = (0..block.bytes()).step_by(CLEAR_BYTES as usize);
    Ok(chunks
        .map(|offset| {
            let bytes = (block.bytes() - offset).min(CLEAR_BYTES);
            Command::Copy { from: Part::of(&zeros, 0, bytes), to: Part::of(block, offset, bytes) }
        })
        .collect())
}

/// Counts wrong integer parts of the roots of 1 to `numbers`.
///
/// # Errors
/// [`GpuError`].
pub fn count_roots(
    bench: &mut Bench,
    root: Root,
    numbers: u32,
) -> Result<Option<root_errors::RootTally>, GpuError> {
    let words = u64::from(numbers).div_ceil(WORD_IDS);
    let Some(groups) = bench.groups(words) else { return Ok(None) };
    let params =
        RootParams { count: numbers, word_count: words as u32, groups_x: groups[0], never: 0 };
    let tally = bench.host(size_of::<RootTally>() as u64)?;
    tally.write(0, &[RootTally::default()]);
    let step = bench.command(MappingStage::RootErrors(root), &[&tally], &params, groups)?;
    let mut frame = bench.frame(vec![step])?;
    bench.run(&mut frame)?;
    let mut counts = [RootTally::default()];
    tally.read(0, &mut counts);
    Ok(Some(root_errors::RootTally {
        count: u64::from(numbers),
        other: u64::from(counts[0].other),
        inexact: u64::from(counts[0].inexact),
    }))
}
