//! The rules as a test that engines hand their words to.

use super::laid::{ByPair, Laid};
use super::look::Look;
use crate::engine::{AvailableIsa, PairTest, Prepared, sift_each};
use crate::filters::{Rules, decide};

/// Boxes up to which pairs are decided one by one: to lay filter data out would take longer.
const FEW_BOXES: usize = 64;
/// Which boxes of a frame are culled.
#[derive(Clone, Copy, Debug)]
pub enum Indices<'a> {
    Same,
    /// Those of a world, then those of all worlds, which do not meet one another here.
    Of(&'a [u32], &'a [u32]),
}

impl Indices<'_> {
    /// The index of a culled box.
    #[inline]
    pub fn global(&self, culled: u32) -> u32 {
        match self {
            Self::Same => culled,
            Self::Of(own, all) => {
                let culled = culled as usize;
                match culled.checked_sub(own.len()) {
                    Some(at) => all.get(at).copied().unwrap_or(u32::MAX),
                    None => own[culled],
                }
            }
        }
    }

    /// Whether a culled box is one of all worlds beside those of one.
    #[inline]
    fn is_of_all(&self, culled: u32) -> bool {
        matches!(self, Self::Of(own, _) if culled as usize >= own.len())
    }
}

/// The rules of a frame.
pub struct FilterTest<'a> {
    rules: &'a Rules,
    indices: Indices<'a>,
    by_pair: ByPair,
    laid: Prepared<Laid>,
}

impl<'a> FilterTest<'a> {
    /// The test of a frame's rules at which a look was had. `memory` is what an earlier test gave back.
    pub fn new(rules: &'a Rules, look: &Look, indices: Indices<'a>, memory: Laid) -> Self {
        // Boxes that are culled by world are all of one.
        let worlds_matter = look.worlds.is_some() && matches!(indices, Indices::Same);
        let by_pair = ByPair { owners: look.has_owners, worlds: worlds_matter };
        Self { rules, indices, by_pair, laid: Prepared::new(memory) }
    }

    /// Gives the memory back for the next frame.
    pub fn into_memory(self) -> Laid {
        self.laid.into_memory()
    }

    /// The bits whose pairs pass, one by one.
    fn passing_each(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let culled = |at: u32| order.get(at as usize).map_or(at, |index| *index);
        let row = culled(row);
        let one = self.indices.global(row);
        let (filter_data, is_of_all) = (self.rules.filter_data(one), self.indices.is_of_all(row));
        let (mut passing, mut rest) = (0, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            let at = culled(32 * block + column);
            let other = self.indices.global(at);
            let Rules { table, lists, .. } = self.rules;
            let listed = || lists.listed(one, other);
            let meet = decide(&filter_data, &self.rules.filter_data(other), table, listed)
                && !(is_of_all && self.indices.is_of_all(at));
            passing |= u32::from(meet) << column;
            rest &= rest - 1;
        }
        passing
    }
}

impl PairTest for FilterTest<'_> {
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let Some(laid) = self.laid.get() else {
            return self.passing_each(row, block, bits, order);
        };
        let lists = &self.rules.lists;
        if !lists.is_empty() {
            let culled = order.get(row as usize).map_or(row, |index| *index);
            if lists.may_be_named(self.indices.global(culled)) {
                return self.passing_each(row, block, bits, order);
            }
        }
        laid.passing(row, block, bits)
    }

    fn sift(&self, words: [&mut [u32]; 3], order: &[u32], isa: AvailableIsa) -> (usize, u64) {
        match self.laid.get() {
            Some(laid) if self.rules.lists.is_empty() => laid.sift(words, isa),
            _ => {
                let passing = |row, block, bits| self.passing(row, block, bits, order);
                sift_each(words, passing, |_| ())
            }
        }
    }

    fn prepare(&self, count: usize, order: &[u32], threads: usize) {
        // Boxes of all worlds beside those of one are reported by their indices.
        let is_plain = matches!(self.indices, Indices::Same | Indices::Of(_, []));
        if count <= FEW_BOXES || !is_plain {
            return;
        }
        let filter_data = |culled: u32| self.rules.filter_data(self.indices.global(culled));
        let rules = (self.rules, self.by_pair);
        self.laid.prepare(|laid| laid.lay_out(rules, count, order, filter_data, threads));
    }
}
