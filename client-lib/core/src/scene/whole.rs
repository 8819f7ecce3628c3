//! All pairs of a scene, found anew by the engine that the plan chooses.

use super::pair_list::{Pair, Sorter};
use crate::aabb::Aabb;
use crate::dispatch::{CpuEngines, CullOptions};
use crate::engine::{CullError, EngineName, HeapReply, ReserveError};
use crate::mask::{Encoding, EncodingChoice, MaskView};
use crate::units::BoxCount;

/// Most bytes of a list: its pairs are counted in 32 bits.
const LIST_BYTES: u64 = 8 * (u32::MAX as u64);

/// Engines, and the memory that they keep.
pub(super) struct Whole {
    engines: CpuEngines,
    reply: HeapReply,
    sorter: Sorter,
    last_pairs: Option<u64>,
}

impl Default for Whole {
    fn default() -> Self {
        Self {
            engines: CpuEngines::new(),
            reply: HeapReply::with_limit_bytes(LIST_BYTES),
            sorter: Sorter::default(),
            last_pairs: None,
        }
    }
}

impl Whole {
    /// Writes those pairs of `boxes` that are wanted, sorted. Returns how many pairs were compared.
    ///
    /// # Errors
    /// [`CullError`] where there is no memory for the pairs, or there are 2^32 or more.
    pub fn pairs(
        &mut self,
        boxes: &[Aabb],
        wanted: &(impl Fn(Pair) -> bool + Sync),
        threads: usize,
        sorted: &mut Vec<Pair>,
    ) -> Result<u64, CullError> {
        sorted.clear();
        let Some(n) = BoxCount::of_len(boxes.len()).filter(|n| !n.is_empty()) else { return Ok(0) };
        let options = CullOptions {
            encoding: EncodingChoice::Only(Encoding::List),
            threads: Some(threads),
            last_pairs: self.last_pairs,
            ..CullOptions::default()
        };
        let answer = self.engines.cull(boxes, &options, &mut self.reply)?;
        self.last_pairs = Some(answer.report.pair_count);
        let Ok(MaskView::List(list)) = MaskView::new(n, &answer.report.shape, self.reply.words())
        else {
            // Engines write what they are asked for.
            let (engine, why) = (EngineName::CpuGrid, "it wrote no list");
            return Err(CullError::Unavailable { engine, why });
        };
        let needed_bytes = 8 * list.len() as u64;
        let no_memory = |_| CullError::Reserve(ReserveError::OutOfMemory { needed_bytes });
        sorted.try_reserve(list.len()).map_err(no_memory)?;
        self.sorter.sorted_from(list.as_pairs(), wanted, n.get(), threads, sorted);
        Ok(n.pair_count().saturating_sub(answer.report.skipped.pairs))
    }

    /// Sorts pairs of `n` boxes, none of them twice.
    pub fn sort(&mut self, pairs: &mut Vec<Pair>, n: usize, threads: usize) {
        self.sorter.sort(pairs, n as u32, threads);
    }

    /// Bytes that are kept.
    pub fn allocated_bytes(&self) -> usize {
        self.engines.scratch_bytes() + self.sorter.allocated_bytes() + self.reply.allocated_bytes()
    }

    /// Gives memory back that only whole scenes need.
    pub fn give_back(&mut self) {
        self.engines.give_back();
        self.sorter.give_back();
        self.reply = HeapReply::with_limit_bytes(LIST_BYTES);
    }
}
