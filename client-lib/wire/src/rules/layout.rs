//! Rules as a request holds them.

use pairmask_core::filters::Rules;
use pairmask_core::units::BoxCount;

use super::entries::{FILTER_WORDS, words_of};
use super::sections::{FILTER_DATA_BYTES, PARTS, RulesSections, most_pairs};
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
    slot: RulesSections,
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
        let filter_data = rules.filter_data.len().min(n.len());
        let counts = [filter_data, rules.table.filters().len(), included.len(), excluded.len()];
        let (mut slot, mut end) = (RulesSections::default(), behind);
        let parts = PARTS.into_iter().zip(counts).zip(&mut slot.0);
        for (((kind, entry_bytes, _), count), to) in parts.filter(|((_, count), _)| *count > 0) {
            let offset = end.next_multiple_of(LINE_BYTES);
            *to = Section::required(kind, offset, entry_bytes * count as u64);
            end = offset + to.bytes;
        }
        Ok(Self { slot, included, excluded, end })
    }

    /// Where they lie.
    pub const fn sections(&self) -> RulesSections {
        self.slot
    }

    /// Bytes of the payload with the rules.
    pub const fn payload_bytes(&self) -> u64 {
        self.end
    }

    /// Bytes beside the boxes and their filter data, with room for as much again: what a frame with a few more
    /// filters or pairs will need.
    pub fn bytes_beside_filter_data(&self) -> u64 {
        2 * self.slot.0[1..].iter().map(|part| part.bytes).sum::<u64>() + 4 * LINE_BYTES
    }

    /// Bytes of the filter data of so many boxes.
    pub const fn filter_data_bytes(n: BoxCount) -> u64 {
        FILTER_DATA_BYTES * n.get() as u64
    }

    /// Writes the rules that this is the layout of. Returns `false`, with part of them written, where the
    /// pages are too few.
    #[must_use]
    pub fn write(&self, rules: &Rules, pages: &mut [Page]) -> bool {
        let filter_data =
            rules.filter_data.get(..(self.slot.0[0].bytes / FILTER_DATA_BYTES) as usize);
        let words: Vec<[u32; FILTER_WORDS]> = rules.table.filters().iter().map(words_of).collect();
        let parts: [&[u8]; 4] = [
            bytemuck::cast_slice(filter_data.unwrap_or_default()),
            bytemuck::cast_slice(&words),
            bytemuck::cast_slice(&self.included),
            bytemuck::cast_slice(&self.excluded),
        ];
        self.slot.0.iter().zip(parts).all(|(section, from)| section.put(from, pages, true))
    }
}
