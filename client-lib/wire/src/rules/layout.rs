//! Rules as a request holds them.

use pairmask_core::filters::Rules;
use pairmask_core::units::BoxCount;

use super::items::{FILTER_WORDS, words_of};
use super::place::{PARTS, RulesPlace, TAG_BYTES, most_pairs};
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
        let tags = rules.tags.len().min(n.len());
        let counts = [tags, rules.table.filters().len(), included.len(), excluded.len()];
        let (mut place, mut end) = (RulesPlace::default(), behind);
        let parts = PARTS.into_iter().zip(counts).zip(&mut place.0);
        for (((kind, item_bytes, _), count), to) in parts.filter(|((_, count), _)| *count > 0) {
            let offset = end.next_multiple_of(LINE_BYTES);
            *to = Section::required(kind, offset, item_bytes * count as u64);
            end = offset + to.bytes;
        }
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
    pub fn bytes_beside_tags(&self) -> u64 {
        2 * self.place.0[1..].iter().map(|part| part.bytes).sum::<u64>() + 4 * LINE_BYTES
    }

    /// Bytes of so many tags.
    pub const fn tag_bytes(n: BoxCount) -> u64 {
        TAG_BYTES * n.get() as u64
    }

    /// Writes the rules that this is the layout of. Returns `false`, with part of them written, where the
    /// pages are too few.
    #[must_use]
    pub fn write(&self, rules: &Rules, pages: &mut [Page]) -> bool {
        let tags = rules.tags.get(..(self.place.0[0].bytes / TAG_BYTES) as usize);
        let words: Vec<[u32; FILTER_WORDS]> = rules.table.filters().iter().map(words_of).collect();
        let parts: [&[u8]; 4] = [
            bytemuck::cast_slice(tags.unwrap_or_default()),
            bytemuck::cast_slice(&words),
            bytemuck::cast_slice(&self.included),
            bytemuck::cast_slice(&self.excluded),
        ];
        self.place.0.iter().zip(parts).all(|(section, from)| section.put(from, pages, true))
    }
}
