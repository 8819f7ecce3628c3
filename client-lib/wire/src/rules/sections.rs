//! Where the rules of a frame lie.

use pairmask_core::units::BoxCount;

use super::entries::{FILTER_DATA_WORDS, FILTER_WORDS, NAMED_PER_BOX, PAIR_WORDS};
use crate::reject::Reject;
use crate::section::{SECTION_COUNT, Section, SectionKind, find, has};

pub(super) const FILTER_DATA_BYTES: u64 = 4 * FILTER_DATA_WORDS as u64;
pub(super) const FILTER_BYTES: u64 = 4 * FILTER_WORDS as u64;
pub(super) const PAIR_BYTES: u64 = 4 * PAIR_WORDS as u64;

/// The parts of rules: filter data of the first boxes (those beyond have the default), filters, and both lists of pairs. The
/// kind of their sections, the bytes of an item, and their names.
pub(crate) const PARTS: [(SectionKind, u64, &str); 4] = [
    (SectionKind::RuleFilterData, FILTER_DATA_BYTES, "filter data"),
    (SectionKind::RuleFilters, FILTER_BYTES, "filters"),
    (SectionKind::IncludedPairs, PAIR_BYTES, "include list"),
    (SectionKind::ExcludedPairs, PAIR_BYTES, "exclude list"),
];

/// Filters of a table at most: as many as there are ids.
const MOST_FILTERS: u64 = 1 << 16;
/// Listed pairs that a frame may have, however few its boxes are: all pairs of 362 boxes.
const PAIRS_OF_ANY: u64 = 1 << 16;

/// Pairs that the lists of a frame may have together.
pub(super) const fn most_pairs(n: BoxCount) -> u64 {
    NAMED_PER_BOX * n.get() as u64 + PAIRS_OF_ANY
}

/// Where the rules of a frame lie in its payload: sections of their parts that are unused where there is nothing to
/// say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RulesSections(pub(super) [Section; 4]);

impl RulesSections {
    pub(crate) fn sections(&self) -> impl Iterator<Item = Section> {
        self.0.into_iter().filter(Section::is_used)
    }

    /// The rules of a frame of `n` boxes, by the sections of a copied header; `None` where it has none.
    pub(crate) fn find(
        sections: &[Section; SECTION_COUNT],
        n: BoxCount,
        payload_bytes: u64,
    ) -> Result<Option<Self>, Reject> {
        let (pairs, mut slot) = (most_pairs(n), Self::default());
        let most = [u64::from(n.get()), MOST_FILTERS, pairs, pairs];
        for (((kind, entry_bytes, name), most), to) in PARTS.into_iter().zip(most).zip(&mut slot.0)
        {
            if has(sections, kind) {
                let only = find(sections, kind, entry_bytes, payload_bytes);
                let only = only.filter(|only| only.bytes / entry_bytes <= most);
                *to = only.ok_or(Reject::Rules(name))?;
            }
        }
        let [_, _, included, excluded] = slot.0;
        if included.bytes + excluded.bytes > PAIR_BYTES * pairs {
            return Err(Reject::Rules("number of pairs"));
        }
        Ok((slot != Self::default()).then_some(slot))
    }
}
