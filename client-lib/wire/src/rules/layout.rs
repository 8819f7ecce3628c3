//! Rules as a request holds them.

use pairmask_core::bytes;
use pairmask_core::filters::Rules;
use pairmask_core::units::BoxCount;

use super::items::{FILTER_WORDS, words_of};
use super::place::{FILTER_BYTES, PAIR_BYTES, RulesPlace, TAG_BYTES, most_pairs};
use crate::page::Page;
use crate::section::Section;

/// Parts begin on a cache line.
const LINE_BYTES: u64 = 64;

/// More pairs on the lists of a frame than a request may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{pairs} listed pairs are too many for a frame that is sent: it has at most {limit}")]
#[non_exhaustive]
pub struct TooManyPairs {
    /// Pairs on the lists.
    pub pairs: u64,
    /// How many are allowed.
    pub limit: u64,
}

/// Where the rules of a frame are written behind its boxes.
#[derive(Clone, Debug)]
pub struct RulesLayout {
    place: RulesPlace,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
    end: u64,
}

impl RulesLayout {
    /// The layout of rules for `n` boxes, which end `behind` bytes into the payload. What names indices
    /// beyond the boxes is left out: it decides of nothing.
    ///
    /// # Errors
    /// [`TooManyPairs`].
    pub fn of(rules: &Rules, n: BoxCount, behind: u64) -> Result<Self, TooManyPairs> {
        let own = |pair: &[u32; 2]| pair[0] < n.get() && pair[1] < n.get();
        let included: Vec<[u32; 2]> = rules.lists.included().filter(own).collect();
        let excluded: Vec<[u32; 2]> = rules.lists.excluded().filter(own).collect();
        let (pairs, limit) = ((included.len() + excluded.len()) as u64, most_pairs(n));
        if pairs > limit {
            return Err(TooManyPairs { pairs, limit });
        }
        let mut end = behind;
        let mut section = |kind, item_bytes: u64, count: usize| {
            if count == 0 {
                return Section::default();
            }
            let offset = end.next_multiple_of(LINE_BYTES);
            let bytes = item_bytes * count as u64;
            end = offset + bytes;
            Section::required(kind, offset, bytes)
        };
        let [tags, filters, include, exclude] = RulesPlace::KINDS;
        let tag_count = rules.tags.len().min(n.len());
        let place = RulesPlace {
            tags: section(tags, TAG_BYTES, tag_count),
            filters: section(filters, FILTER_BYTES, rules.table.filters().len()),
            included: section(include, PAIR_BYTES, included.len()),
            excluded: section(exclude, PAIR_BYTES, excluded.len()),
        };
        Ok(Self { place, included, excluded, end })
    }

    /// Where they lie.
    pub const fn place(&self) -> RulesPlace {
        self.place
    }

    /// Bytes of the payload with the rules.
    pub const fn payload_bytes(&self) -> u64 {
        self.end
    }

    /// Bytes beside the boxes and their tags, with room for as much again: what a frame with a few more
    /// filters or pairs will want.
    pub const fn bytes_beside_tags(&self) -> u64 {
        let RulesPlace { filters, included, excluded, .. } = self.place;
        2 * (filters.bytes + included.bytes + excluded.bytes) + 4 * LINE_BYTES
    }

    /// Bytes of so many tags.
    pub const fn tag_bytes(n: BoxCount) -> u64 {
        TAG_BYTES * n.get() as u64
    }

    /// Writes the rules that this is the layout of. Returns `false`, with part of them written, where the
    /// pages are too few.
    #[must_use]
    pub fn write(&self, rules: &Rules, pages: &mut [Page]) -> bool {
        let all: &mut [u8] = bytemuck::cast_slice_mut(pages);
        let mut put = |section: Section, from: &[u8]| {
            let place = all.get_mut(section.offset as usize..);
            let place = place.and_then(|to| to.get_mut(..from.len()));
            // As boxes are written: many on the calling thread's pool.
            place.map(|to| bytes::copy(from, to, true)).is_some()
        };
        let RulesPlace { tags, filters, included, excluded } = self.place;
        let own_tags = rules.tags.get(..(tags.bytes / TAG_BYTES) as usize).unwrap_or_default();
        let words: Vec<[u32; FILTER_WORDS]> = rules.table.filters().iter().map(words_of).collect();
        put(tags, bytemuck::cast_slice(own_tags))
            && put(filters, bytemuck::cast_slice(&words))
            && put(included, bytemuck::cast_slice(&self.included))
            && put(excluded, bytemuck::cast_slice(&self.excluded))
    }
}
