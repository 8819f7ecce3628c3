//! The answers of a variant on a device, id by id, for comparison with the mirrors.

use pairmaskd::execute::gpu::GpuError;

use super::{Bench, zeroed};
use crate::study::mapping::layouts::MappingPairsParams;
use crate::study::mapping::mirror::Mapped;
use crate::study::mapping::stage::{IdWidth, MappingStage, Variant};

/// Maps `ids` on the device. Ids past the variant's last one have no meaning.
///
/// # Errors
/// [`GpuError`]; a device without 64-bit integers refuses [`IdWidth::Bits64`].
pub fn map(
    bench: &mut Bench,
    variant: Variant,
    width: IdWidth,
    n: u32,
    ids: &[u64],
) -> Result<Vec<Mapped>, GpuError> {
    let bytes = size_of_val(ids) as u64;
    let (from, to) = (bench.host(bytes)?, bench.host(bytes)?);
    from.write(0, ids);
    let params = MappingPairsParams { n, id_count: ids.len() as u32 };
    // A few thousand ids: one row of workgroups.
    let groups = bench.groups(ids.len() as u64).map_or([1, 1], |groups| [groups[0], 1]);
    let stage = MappingStage::Pairs(variant, width);
    let step = bench.command(stage, &[&from, &to], &params, groups)?;
    let mut frame = bench.frame(vec![step])?;
    bench.run(&mut frame)?;
    let mut pairs: Vec<[i32; 2]> = zeroed(ids.len());
    to.read(0, &mut pairs);
    Ok(pairs.iter().map(|[a, b]| Mapped { a: i64::from(*a), b: i64::from(*b) }).collect())
}
