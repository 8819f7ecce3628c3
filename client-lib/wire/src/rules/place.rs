//! Where the rules of a frame lie.

use pairmask_core::units::BoxCount;

use super::items::{FILTER_WORDS, NAMED_PER_BOX, PAIR_WORDS, TAG_WORDS};
use crate::reject::Reject;
use crate::section::{SECTION_COUNT, Section, SectionKind};

/// Bytes of a tag, a filter and a pair.
pub(super) const TAG_BYTES: u64 = 4 * TAG_WORDS as u64;
pub(super) const FILTER_BYTES: u64 = 4 * FILTER_WORDS as u64;
pub(super) const PAIR_BYTES: u64 = 4 * PAIR_WORDS as u64;

/// Filters of a table at most: as many as there are ids.
const MOST_FILTERS: u64 = 1 << 16;
/// Listed pairs that a frame may have, however few its boxes are: all pairs of 362 boxes.
const PAIRS_OF_ANY: u64 = 1 << 16;

/// Pairs that the lists of a frame may have together.
pub(super) const fn most_pairs(n: BoxCount) -> u64 {
    NAMED_PER_BOX * n.get() as u64 + PAIRS_OF_ANY
}

/// Where the rules of a frame lie in its payload: sections that are unused where there is nothing to say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RulesPlace {
    /// Tags of the first boxes; those beyond have the default tag.
    pub(super) tags: Section,
    pub(super) filters: Section,
    /// The include list.
    pub(super) included: Section,
    /// The exclude list.
    pub(super) excluded: Section,
}

impl RulesPlace {
    pub(crate) const KINDS: [SectionKind; 4] = [
        SectionKind::RuleTags,
        SectionKind::RuleFilters,
        SectionKind::IncludedPairs,
        SectionKind::ExcludedPairs,
    ];

    pub(crate) fn sections(&self) -> impl Iterator<Item = Section> {
        let Self { tags, filters, included, excluded } = *self;
        [tags, filters, included, excluded].into_iter().filter(Section::is_used)
    }

    /// The rules of a frame of `n` boxes, by the sections of a copied header; `None` where it has none.
    ///
    /// # Errors
    /// [`Reject::Rules`].
    pub(crate) fn find(
        sections: &[Section; SECTION_COUNT],
        n: BoxCount,
        payload_bytes: u64,
    ) -> Result<Option<Self>, Reject> {
        let section = |kind: SectionKind, item_bytes: u64, most: u64, field| {
            let mut found = sections.iter().filter(|section| section.kind == kind as u32);
            let Some(first) = found.next() else { return Ok(Section::default()) };
            let is_right = found.next().is_none()
                && first.fits(payload_bytes)
                && first.bytes.is_multiple_of(item_bytes)
                && first.bytes / item_bytes <= most;
            if is_right { Ok(*first) } else { Err(Reject::Rules { field }) }
        };
        let pairs = most_pairs(n);
        let [tags, filters, included, excluded] = Self::KINDS;
        let place = Self {
            tags: section(tags, TAG_BYTES, u64::from(n.get()), "tags")?,
            filters: section(filters, FILTER_BYTES, MOST_FILTERS, "filters")?,
            included: section(included, PAIR_BYTES, pairs, "include list")?,
            excluded: section(excluded, PAIR_BYTES, pairs, "exclude list")?,
        };
        if place.included.bytes + place.excluded.bytes > PAIR_BYTES * pairs {
            return Err(Reject::Rules { field: "number of pairs" });
        }
        Ok((place != Self::default()).then_some(place))
    }
}
