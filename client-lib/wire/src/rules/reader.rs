//! Rules as a request brings them.

use std::sync::Arc;

use pairmask_core::bytes;
use pairmask_core::filters::{Filter, FilterData, FilterTable, PairLists, Rules, World};
use pairmask_core::units::BoxCount;

use super::entries::{FILTER_WORDS, filter_of};
use super::sections::{PARTS, RulesSections};
use crate::page::Page;
use crate::reject::Reject;

/// The rules of a frame, copied from its request and validated.
#[derive(Debug, Default)]
pub struct SentRules {
    rules: Rules,
    n: BoxCount,
    /// What the table and the lists were made from, to know them again.
    filters: Vec<[u32; FILTER_WORDS]>,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
    worlds: Option<[i32; 2]>,
    let_all_meet: bool,
    number: u64,
}

impl SentRules {
    /// The rules. All pairs of their lists name boxes of the frame.
    pub const fn rules(&self) -> &Rules {
        &self.rules
    }

    /// The most worlds that pairs can be of: 0 where all boxes are of one.
    pub fn most_worlds(&self) -> u64 {
        let width = |[least, greatest]: [i32; 2]| (i64::from(greatest) - i64::from(least)) as u64;
        // World::ALL is one more.
        self.worlds.map_or(0, |span| (width(span) + 2).min(u64::from(self.n.get())))
    }

    /// Whether all boxes meet.
    pub const fn let_all_meet(&self) -> bool {
        self.let_all_meet
    }

    /// The number of these rules among those of their reader: others have another. Never 0.
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.rules.allocated_bytes()
            + self.filters.capacity() * size_of::<[u32; FILTER_WORDS]>()
            + (self.included.capacity() + self.excluded.capacity()) * size_of::<[u32; 2]>()
    }
}

/// Reads rules. Those of a frame that has the rules of the one before are only compared.
#[derive(Debug, Default)]
pub struct RulesReader {
    kept: Arc<SentRules>,
    number: u64,
    /// The number that the client gave the rules; 0 where it gave none.
    named: u64,
}

impl RulesReader {
    /// The rules of a frame of `n` boxes, from its payload. All is copied before it is used, and checked in
    /// the copy. Holders of earlier rules keep what they have.
    ///
    /// # Errors
    /// [`Reject::Rules`] with the first field that is wrong.
    pub fn read(
        &mut self,
        slot: &RulesSections,
        n: BoxCount,
        pages: &[Page],
    ) -> Result<&Arc<SentRules>, Reject> {
        self.named = 0;
        let mut parts: [&[u8]; 4] = [&[]; 4];
        for ((to, section), (_, _, name)) in parts.iter_mut().zip(&slot.0).zip(PARTS) {
            *to = section.bytes_in(pages).ok_or(Reject::Rules(name))?;
        }
        let [filter_data, filters, included, excluded] = parts;
        let kept = &*self.kept;
        // Filter data of millions of boxes takes a thread milliseconds.
        let is_shared = bytes::is_in_pool();
        let [has_filter_data, has_filters, has_included, has_excluded] = [
            bytes::are_equal(
                filter_data,
                bytemuck::cast_slice::<FilterData, u8>(&kept.rules.filter_data),
                is_shared,
            ),
            filters == bytemuck::cast_slice::<[u32; FILTER_WORDS], u8>(&kept.filters),
            included == bytemuck::cast_slice::<[u32; 2], u8>(&kept.included),
            excluded == bytemuck::cast_slice::<[u32; 2], u8>(&kept.excluded),
        ];
        let has_lists = has_included && has_excluded && kept.n == n;
        if has_filter_data && has_filters && has_lists && kept.number != 0 {
            return Ok(&self.kept);
        }
        if Arc::get_mut(&mut self.kept).is_none() {
            // A frame that is under way has them.
            self.kept = Arc::default();
            return self.read(slot, n, pages);
        }
        self.number += 1;
        let changed = Arc::get_mut(&mut self.kept).ok_or(Reject::Rules("filter data"))?;
        // What an error leaves behind is read anew.
        (changed.number, changed.n) = (0, n);
        if !has_filter_data {
            take(&mut changed.rules.filter_data, filter_data);
        }
        if !has_filters {
            take(&mut changed.filters, filters);
            let filters: Vec<Filter> = changed.filters.iter().map(filter_of).collect();
            let table = FilterTable::new(&filters);
            changed.rules.table = table.map_err(|_| Reject::Rules("filters"))?;
        }
        if !has_lists {
            take(&mut changed.included, included);
            take(&mut changed.excluded, excluded);
            let is_own = |pair: &[u32; 2]| pair.iter().all(|index| *index < n.get());
            let own = [&changed.included, &changed.excluded].map(|list| list.iter().all(is_own));
            if own != [true; 2] {
                changed.included.clear();
                changed.excluded.clear();
                changed.rules.lists = PairLists::new();
                let field = if own[0] { "exclude list" } else { "include list" };
                return Err(Reject::Rules(field));
            }
            let mut lists = PairLists::new();
            for pair in &changed.included {
                lists.include(*pair, true);
            }
            for pair in &changed.excluded {
                lists.exclude(*pair, true);
            }
            changed.rules.lists = lists;
        }
        changed.worlds = span_of_worlds(&changed.rules, n);
        changed.let_all_meet = changed.rules.let_all_meet(n.len());
        changed.number = self.number;
        Ok(&self.kept)
    }

    /// As [`read`](Self::read), of rules that the client gave a number, by which it names them later.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_named(
        &mut self,
        slot: &RulesSections,
        number: u64,
        n: BoxCount,
        pages: &[Page],
    ) -> Result<&Arc<SentRules>, Reject> {
        self.read(slot, n, pages)?;
        self.named = number;
        Ok(&self.kept)
    }

    /// The rules of a number, of `n` boxes.
    ///
    /// # Errors
    /// [`Reject::UnknownRules`] where the rules that were read last are others, or have no number.
    pub fn named(&self, number: u64, n: BoxCount) -> Result<&Arc<SentRules>, Reject> {
        let is_kept = number != 0 && self.named == number && self.kept.n == n;
        if is_kept { Ok(&self.kept) } else { Err(Reject::UnknownRules) }
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.kept.allocated_bytes()
    }

    /// Gives the memory back.
    pub fn give_back(&mut self) {
        self.kept = Arc::default();
        self.named = 0;
    }
}

/// Takes a copy of items.
fn take<T: bytemuck::Pod>(entries: &mut Vec<T>, from: &[u8]) {
    entries.resize(from.len() / size_of::<T>(), T::zeroed());
    bytes::copy(from, bytemuck::cast_slice_mut::<T, u8>(entries), bytes::is_in_pool());
}

/// The least and the greatest world beside [`World::ALL`], where there are several.
fn span_of_worlds(rules: &Rules, n: BoxCount) -> Option<[i32; 2]> {
    let unfiltered = (rules.filter_data.len() < n.len()).then_some(World::default());
    let worlds = rules.filter_data.iter().map(|filter_data| filter_data.world).chain(unfiltered);
    let (least, greatest) = worlds
        .filter(|world| *world != World::ALL)
        .fold((i32::MAX, i32::MIN), |(least, greatest), World(world)| {
            (least.min(world), greatest.max(world))
        });
    (least < greatest).then_some([least, greatest])
}
