//! Queries among boxes that cells do not part: each compared with each box, or one cull of both, of which only pairs
//! of a query and a box count.

use super::{Room, direct};
use crate::aabb::Aabb;
use crate::dispatch::{CpuEngines, CullOptions};
use crate::engine::{CullError, EngineName, HeapReply, counted};
use crate::mask::{Encoding, EncodingChoice};
use crate::scene::pair_list::{PAIR_BYTES, Pair, Sorter};
use crate::scene::whole::list_of;
use crate::units::BoxCount;

/// Queries up to which each is compared with each box: with so many, a box takes about as long as in a cull.
const FEW_QUERIES: usize = 512;

/// Finds the boxes that queries overlap, by query and then by index. Returns how many pairs were compared.
pub(super) fn find(
    boxes: &[Aabb],
    queries: &[Aabb],
    threads: usize,
    room: &Room<'_>,
    found: &mut Vec<Pair>,
) -> Result<u64, CullError> {
    if queries.len() <= FEW_QUERIES {
        return direct::find(boxes, queries, threads, room, found);
    }
    let all = [queries, boxes].concat();
    let n = counted(&all, EngineName::CpuTree)?;
    let first = queries.len() as u32;
    let encoding = EncodingChoice::Only(Encoding::List);
    let options = CullOptions { encoding, threads: Some(threads), ..CullOptions::default() };
    let mut reply = HeapReply::with_limit_bytes(PAIR_BYTES * room.most);
    reply.set_asker(room.cancel.asker());
    let mut engines = CpuEngines::new();
    let answer = engines.cull_sets(&all, BoxCount::new(first), &options, &mut reply)?;
    let list = list_of(n, &answer.report, reply.words())?;
    super::reserve(found, list.len())?;
    found.extend(list.iter().map(|[query, index]| [*query, index - first]));
    Sorter::default().sort(found, first, threads, room.cancel);
    room.check()?;
    Ok(n.pair_count().saturating_sub(answer.report.skipped.pairs))
}
