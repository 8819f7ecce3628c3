//! All pairs of a scene, as it is and as it was, found anew by the engine that the plan chooses.

use super::pair_list::{PAIR_BYTES, Pair, Sorter};
use super::store::Store;
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::dispatch::{CpuEngines, CullOptions};
use crate::engine::{CullError, CullReport, EngineName, HeapReply, ReserveError};
use crate::mask::{Encoding, EncodingChoice, MaskView};
use crate::units::BoxCount;

/// Most pairs of a list: they are counted in 32 bits.
const MOST_PAIRS: u64 = u32::MAX as u64;

/// Engines, and the memory that they keep.
pub(super) struct Whole {
    engines: CpuEngines,
    reply: HeapReply,
    most_pairs: u64,
    sorter: Sorter,
    last_pairs: Option<u64>,
    compared: Option<u64>,
}

impl Whole {
    /// Whole scenes by some engines.
    pub fn new(engines: CpuEngines) -> Self {
        Self {
            engines,
            reply: HeapReply::with_limit_bytes(PAIR_BYTES * MOST_PAIRS),
            most_pairs: MOST_PAIRS,
            sorter: Sorter::default(),
            last_pairs: None,
            compared: None,
        }
    }

    /// Most pairs that lists may have from now on.
    pub fn limit_pairs(&mut self, most: u64) {
        let most = most.min(MOST_PAIRS);
        if most != self.most_pairs {
            self.most_pairs = most;
            self.reply = HeapReply::with_limit_bytes(PAIR_BYTES * most);
        }
    }

    /// Writes those pairs of `boxes` that are needed, sorted. Returns how many pairs were compared.
    ///
    /// # Errors
    /// [`CullError`] where there is no memory for the pairs, there are more than [may be](Self::limit_pairs), or nobody
    /// waits for them.
    pub fn pairs(
        &mut self,
        boxes: &[Aabb],
        requested: &(impl Fn(Pair) -> bool + Sync),
        (threads, cancel): (usize, &Cancel),
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
        self.reply.set_asker(cancel.asker());
        let answer = self.engines.cull(boxes, &options, &mut self.reply);
        self.reply.set_asker(None);
        let answer = answer?;
        self.last_pairs = Some(answer.report.pair_count);
        let list = list_of(n, &answer.report, self.reply.words())?;
        let needed_bytes = PAIR_BYTES * list.len() as u64;
        let no_memory = |_| CullError::Reserve(ReserveError::OutOfMemory { needed_bytes });
        sorted.try_reserve(list.len()).map_err(no_memory)?;
        self.sorter.sorted_from(list, requested, n.get(), threads, cancel, sorted);
        if cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        let compared = n.pair_count().saturating_sub(answer.report.skipped.pairs);
        self.compared = Some(compared);
        Ok(compared)
    }

    /// The pairs of a scene when its history began, sorted. Returns how many pairs were compared.
    ///
    /// # Errors
    /// As [`Self::pairs`].
    pub fn pairs_then(
        &mut self,
        store: &Store,
        threads: (usize, &Cancel),
        sorted: &mut Vec<Pair>,
    ) -> Result<u64, CullError> {
        let (then, statics) = store.then();
        let were_still = |[a, b]: Pair| statics[a as usize] && statics[b as usize];
        let were_pairs = |pair: Pair| !were_still(pair) && store.states.filters.met(pair);
        self.pairs(&then, &were_pairs, threads, sorted)
    }

    /// How many pairs were compared the last time.
    pub const fn compared(&self) -> Option<u64> {
        self.compared
    }

    /// Most pairs that lists may have.
    pub const fn most_pairs(&self) -> u64 {
        self.most_pairs
    }

    /// Memory to sort with.
    pub const fn sorter(&mut self) -> &mut Sorter {
        &mut self.sorter
    }

    pub fn allocated_bytes(&self) -> usize {
        self.engines.scratch_bytes() + self.sorter.allocated_bytes() + self.reply.allocated_bytes()
    }

    /// Gives memory back that only whole scenes need.
    pub fn give_back(&mut self) {
        self.engines.give_back();
        self.sorter.give_back();
        self.reply = HeapReply::with_limit_bytes(PAIR_BYTES * self.most_pairs);
    }
}

/// The list that an engine has written.
pub(super) fn list_of<'a>(
    n: BoxCount,
    report: &CullReport,
    reply: &'a [u32],
) -> Result<&'a [Pair], CullError> {
    if let Ok(MaskView::List(list)) = MaskView::new(n, &report.shape, reply) {
        return Ok(list.as_pairs());
    }
    // Engines write what they are asked for.
    let (engine, why) = (EngineName::CpuGrid, "it wrote no list");
    Err(CullError::Unavailable { engine, why })
}

#[cfg(test)]
mod tests {
    use crate::aabb::Aabb;
    use crate::engine::{CullError, ReserveError};
    use crate::scene::{Edit, Report, Reported, Scene, SceneError, SceneOptions, Sets, Step};

    /// Most pairs of the whole scene are an error before there is memory for them, and those within the limit an
    /// answer.
    #[test]
    fn a_scene_has_no_more_pairs_than_may_be() {
        let boxes = vec![Aabb::new([0.0; 3], [1.0; 3]); 2_000];
        let all = [Step::Set(Sets { indices: (0..2_000).into(), boxes: &boxes })];
        let pairs = 2_000 * 1_999 / 2;
        let answer = |report: Report, most: u64| {
            let mut scene = Scene::new(SceneOptions::default().with_threads(1));
            scene.limit_pairs(most);
            scene.edit(Edit { steps: &all }, report).map(Reported::pair_count)
        };
        for report in [Report::All, Report::Changes] {
            let too_large = |error| {
                matches!(error, SceneError::Cull(CullError::Reserve(ReserveError::TooLarge { .. })))
            };
            assert!(answer(report, pairs - 1).is_err_and(too_large), "{report:?}");
            assert_eq!(answer(report, pairs), Ok(Some(pairs)), "{report:?}");
        }
    }
}
