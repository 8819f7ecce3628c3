//! The rules as a test that engines hand their words to.

use std::sync::{Mutex, OnceLock, PoisonError};

use super::look::Look;
use crate::engine::PairTest;
use crate::engine::strips::{in_parts, part_count};
use crate::filters::{Owner, Rules, Tag, World, decide};

/// Boxes up to which tags are read where they lie by index: they fit into a cache.
const FEW_BOXES: usize = 4_096;
/// Boxes of a task that lays tags out, at least.
const TASK_BOXES: usize = 8_192;

/// Which boxes of a frame are culled.
#[derive(Clone, Copy, Debug)]
pub enum Indices<'a> {
    /// All, as they are.
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
    is_in_table: bool,
    /// Tags by the engine's position, once it has said its order. Static where their filters are.
    laid: OnceLock<Vec<Tag>>,
    memory: Mutex<Vec<Tag>>,
}

impl<'a> FilterTest<'a> {
    /// The test of a frame's rules at which a look was had. `memory` is what an earlier test gave back.
    pub fn new(rules: &'a Rules, look: &Look, indices: Indices<'a>, memory: Vec<Tag>) -> Self {
        let is_in_table = look.is_in_table;
        Self { rules, indices, is_in_table, laid: OnceLock::new(), memory: Mutex::new(memory) }
    }

    /// Gives the memory back for the next frame.
    pub fn into_memory(self) -> Vec<Tag> {
        let kept = self.memory.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.laid.into_inner().unwrap_or(kept)
    }

    /// The bits whose pairs pass, of boxes whose tags are laid out. No branch depends on a pair: which of
    /// them pass is as good as random.
    #[inline]
    fn passing_laid(&self, row: u32, block: u32, bits: u32, tags: &[Tag]) -> u32 {
        let (one, columns) = (tags[row as usize], &tags[32 * block as usize..]);
        let kinds = if self.is_in_table { self.rules.table.row(one.filter) } else { None };
        let (mut passing, mut rest) = (0, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            let other = &columns[column as usize];
            let is_of_one = (one.owner == other.owner) & (one.owner != Owner::NONE);
            let worlds_meet = (one.world == other.world)
                | (one.world == World::ALL)
                | (other.world == World::ALL);
            let kinds_meet = match kinds {
                Some(kinds) => {
                    let at = usize::from(other.filter.0);
                    kinds[at / 64] >> (at % 64) & 1 == 1
                }
                None => self.rules.table.meet(one.filter, other.filter),
            };
            let are_static = one.is_static() & other.is_static();
            let meet = worlds_meet & !is_of_one & !are_static & kinds_meet;
            passing |= u32::from(meet) << column;
            rest &= rest - 1;
        }
        passing
    }

    /// The bits whose pairs pass, one by one.
    fn passing_each(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let culled = |at: u32| order.get(at as usize).map_or(at, |index| *index);
        let row = culled(row);
        let one = self.indices.global(row);
        let (tag, is_of_all) = (self.rules.tag(one), self.indices.is_of_all(row));
        let (mut passing, mut rest) = (0, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            let at = culled(32 * block + column);
            let other = self.indices.global(at);
            let Rules { table, lists, .. } = self.rules;
            let meet = decide(&tag, &self.rules.tag(other), table, lists, [one, other])
                && !(is_of_all && self.indices.is_of_all(at));
            passing |= u32::from(meet) << column;
            rest &= rest - 1;
        }
        passing
    }
}

impl PairTest for FilterTest<'_> {
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        match self.laid.get() {
            Some(tags) => self.passing_laid(row, block, bits, tags),
            None => self.passing_each(row, block, bits, order),
        }
    }

    fn prepare(&self, order: &[u32], threads: usize) {
        // Lists name indices, and boxes of all worlds beside those of one are told by theirs.
        let is_plain = matches!(self.indices, Indices::Same | Indices::Of(_, []));
        if order.len() <= FEW_BOXES || !is_plain || !self.rules.lists.is_empty() {
            return;
        }
        let mut tags =
            std::mem::take(&mut *self.memory.lock().unwrap_or_else(PoisonError::into_inner));
        tags.resize(order.len(), Tag::default());
        let parts = part_count(order.len(), TASK_BOXES, threads);
        let step = order.len().div_ceil(parts).max(1);
        let mut work: Vec<(&mut [Tag], &[u32])> =
            tags.chunks_mut(step).zip(order.chunks(step)).collect();
        let run = |work: &mut [(&mut [Tag], &[u32])]| {
            for (tags, order) in work {
                for (laid, culled) in tags.iter_mut().zip(*order) {
                    let tag = self.rules.tag(self.indices.global(*culled));
                    let is_static = tag.is_static() || self.rules.table.is_static(tag.filter);
                    *laid = tag.with_static(is_static);
                }
            }
        };
        in_parts(work.as_mut_slice(), parts, &run, &|(), ()| ());
        // One engine runs, and says its order once.
        let _ = self.laid.set(tags);
    }
}
