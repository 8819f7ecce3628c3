//! The rules as a test that engines hand their words to.

// `&` and `|`: a branch costs more than the second operand.
#![allow(clippy::needless_bitwise_bool)]

use std::sync::{Mutex, OnceLock, PoisonError};

use super::look::Look;
use crate::engine::PairTest;
use crate::engine::strips::{in_parts, part_count};
use crate::filters::{FilterId, Owner, Rules, Tag, World, decide};

/// Boxes up to which pairs are decided one by one: to lay tags out would take longer.
const FEW_BOXES: usize = 64;
/// Boxes of a task that lays tags out, at least. A whole number of blocks.
const TASK_BOXES: usize = 8_192;
/// Kinds up to which each block of columns has a word a kind: those of its columns that the kind meets.
/// Memory is as much as a bit a box and kind.
const MOST_KINDS: usize = 32;
/// Columns of a block.
const BLOCK: usize = 32;

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
    /// Whether owners or worlds part boxes beside their kinds.
    is_by_pair: bool,
    /// What the engine's order is laid out in, once it has said it.
    laid: OnceLock<Laid>,
    memory: Mutex<Laid>,
}

/// The tags of a frame by the engine's position.
#[derive(Debug, Default)]
pub struct Laid {
    /// The tags, where owners or worlds matter.
    tags: Vec<Tag>,
    /// The kind of each box, by index among those that are culled.
    kind_of: Vec<u8>,
    /// The same by position.
    kinds: Vec<u8>,
    kind_count: usize,
    /// For each block of columns and each kind, the columns that the kind meets.
    columns: Vec<u32>,
}

impl Laid {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.tags.capacity() * size_of::<Tag>()
            + self.kind_of.capacity()
            + self.kinds.capacity()
            + self.columns.capacity() * size_of::<u32>()
    }
}

/// The kinds of a frame's boxes: a filter, and whether the box is static.
struct Kinds {
    /// The kinds by rising number.
    kinds: Vec<(FilterId, bool)>,
    /// The kind of each filter, of boxes that are not static and of those that are.
    by_filter: Vec<[Option<u8>; 2]>,
}

impl Kinds {
    /// The kinds of some tags, and that of each tag. `None` where there are too many.
    fn of(rules: &Rules, tags: impl Iterator<Item = Tag>, kind_of: &mut Vec<u8>) -> Option<Self> {
        // Filters that are not in the table are one more kind: all of them meet everything.
        let beyond = rules.table.filters().len();
        let mut all = Self { kinds: Vec::new(), by_filter: vec![[None; 2]; beyond + 1] };
        kind_of.clear();
        for tag in tags {
            let at = usize::from(tag.filter.0).min(beyond);
            let kind = match all.by_filter[at][usize::from(tag.is_static())] {
                Some(kind) => kind,
                None if all.kinds.len() == MOST_KINDS => return None,
                None => {
                    let kind = all.kinds.len() as u8;
                    all.kinds.push((tag.filter, tag.is_static()));
                    all.by_filter[at][usize::from(tag.is_static())] = Some(kind);
                    kind
                }
            };
            kind_of.push(kind);
        }
        Some(all)
    }

    /// For each kind, a bit for each that it meets.
    fn meets(&self, rules: &Rules) -> Vec<u32> {
        let is_static = |(id, of_box): (FilterId, bool)| of_box || rules.table.get(id).is_static;
        let meet = |a: (FilterId, bool), b: (FilterId, bool)| {
            rules.table.meet(a.0, b.0) && !(is_static(a) && is_static(b))
        };
        let row = |a: &(FilterId, bool)| {
            let bits = (0..).zip(&self.kinds);
            bits.fold(0, |row, (bit, b)| row | u32::from(meet(*a, *b)) << bit)
        };
        self.kinds.iter().map(row).collect()
    }
}

impl<'a> FilterTest<'a> {
    /// The test of a frame's rules at which a look was had. `memory` is what an earlier test gave back.
    pub fn new(rules: &'a Rules, look: &Look, indices: Indices<'a>, memory: Laid) -> Self {
        // Boxes that are culled by world are all of one.
        let worlds_matter = look.worlds.is_some() && matches!(indices, Indices::Same);
        let is_by_pair = worlds_matter || look.has_owners;
        Self { rules, indices, is_by_pair, laid: OnceLock::new(), memory: Mutex::new(memory) }
    }

    /// Gives the memory back for the next frame.
    pub fn into_memory(self) -> Laid {
        let kept = self.memory.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.laid.into_inner().unwrap_or(kept)
    }

    /// The bits whose pairs pass, of boxes that are on no list.
    #[inline]
    fn passing_laid(&self, row: u32, block: u32, bits: u32, laid: &Laid) -> u32 {
        let kind = usize::from(laid.kinds[row as usize]);
        let bits = bits & laid.columns[block as usize * laid.kind_count + kind];
        if bits == 0 || !self.is_by_pair {
            return bits;
        }
        let (one, columns) = (laid.tags[row as usize], &laid.tags[BLOCK * block as usize..]);
        let (mut passing, mut rest) = (bits, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            let other = &columns[column as usize];
            // No branch: which pairs pass is as good as random.
            let is_of_one = (one.owner == other.owner) & (one.owner != Owner::NONE);
            let worlds_meet = (one.world == other.world)
                | (one.world == World::ALL)
                | (other.world == World::ALL);
            passing ^= u32::from(is_of_one | !worlds_meet) << column;
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
            let listed = || lists.listed(one, other);
            let meet = decide(&tag, &self.rules.tag(other), table, listed)
                && !(is_of_all && self.indices.is_of_all(at));
            passing |= u32::from(meet) << column;
            rest &= rest - 1;
        }
        passing
    }
}

/// Some positions of an order, and what is laid out for them.
struct Part<'a> {
    order: &'a [u32],
    kinds: &'a mut [u8],
    columns: &'a mut [u32],
    tags: &'a mut [Tag],
}

impl Part<'_> {
    /// `meets` has the kinds that each kind meets.
    fn lay_out(&mut self, kind_of: &[u8], meets: &[u32], tag: impl Fn(u32) -> Tag) {
        for (kind, culled) in self.kinds.iter_mut().zip(self.order) {
            *kind = kind_of[*culled as usize];
        }
        for (laid, culled) in self.tags.iter_mut().zip(self.order) {
            *laid = tag(*culled);
        }
        let blocks = self.columns.chunks_exact_mut(meets.len());
        for (columns, kinds) in blocks.zip(self.kinds.chunks(BLOCK)) {
            let mut of_kind = [0; MOST_KINDS];
            for (column, kind) in kinds.iter().enumerate() {
                of_kind[usize::from(*kind)] |= 1 << column;
            }
            for (columns, meets) in columns.iter_mut().zip(meets) {
                let bits = (0..).zip(&of_kind[..meets_len(*meets)]);
                *columns = bits.fold(0, |sum, (bit, of_kind): (u32, &u32)| {
                    sum | (of_kind & 0u32.wrapping_sub(meets >> bit & 1))
                });
            }
        }
    }
}

/// Kinds up to the last that is met.
const fn meets_len(meets: u32) -> usize {
    (u32::BITS - meets.leading_zeros()) as usize
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
        self.passing_laid(row, block, bits, laid)
    }

    fn prepare(&self, order: &[u32], threads: usize) {
        // Boxes of all worlds beside those of one are told by their indices.
        let is_plain = matches!(self.indices, Indices::Same | Indices::Of(_, []));
        if order.len() <= FEW_BOXES || !is_plain {
            return;
        }
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        let mut laid = std::mem::take(&mut *memory);
        let n = order.len();
        let tag = |culled: u32| self.rules.tag(self.indices.global(culled));
        let Some(kinds) = Kinds::of(self.rules, (0..n as u32).map(tag), &mut laid.kind_of) else {
            *memory = laid;
            return;
        };
        let meets = kinds.meets(self.rules);
        laid.kind_count = meets.len();
        laid.kinds.resize(n, 0);
        laid.columns.resize(n.div_ceil(BLOCK) * meets.len(), 0);
        laid.tags.resize(if self.is_by_pair { n } else { 0 }, Tag::default());

        let parts = part_count(n, TASK_BOXES, threads);
        let step = n.div_ceil(parts).next_multiple_of(BLOCK);
        let mut tags = laid.tags.chunks_mut(step);
        let columns = laid.columns.chunks_mut(step / BLOCK * meets.len());
        let mut work: Vec<Part<'_>> = order
            .chunks(step)
            .zip(laid.kinds.chunks_mut(step).zip(columns))
            .map(|(order, (kinds, columns))| Part {
                order,
                kinds,
                columns,
                tags: tags.next().unwrap_or_default(),
            })
            .collect();
        let kind_of = laid.kind_of.as_slice();
        let run = |work: &mut [Part<'_>]| {
            for part in work {
                part.lay_out(kind_of, &meets, tag);
            }
        };
        in_parts(work.as_mut_slice(), parts, &run, &|(), ()| ());
        // One engine runs, and says its order once.
        let _ = self.laid.set(laid);
    }
}
