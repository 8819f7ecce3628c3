//! Work that answers left out, as `cull` and `status` report it.

use std::fmt;

use pairmask_core::engine::SkipMeter;
use pairmask_wire::SkipTotals;
use serde::{Deserialize, Serialize};

/// Work that was left out. Fields may be added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skipped {
    /// Boxes that were not looked at: they overlap nothing by themselves, or have not moved.
    pub boxes: u64,
    pub pairs: u64,
    pub why: Why,
    /// Words that were not written: zeros of masks; of scenes two for each pair that was told before.
    pub zero_words: u64,
}

/// Pairs that were never compared, by the first reason that holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Why {
    #[serde(rename = "static")]
    pub statics: u64,
    pub unmoved: u64,
    pub empty: u64,
    /// Their cells are too far apart.
    pub cell: u64,
    /// The order along an axis holds them apart.
    pub axis: u64,
}

impl From<&SkipTotals> for Skipped {
    fn from(totals: &SkipTotals) -> Self {
        let SkipTotals { boxes, words, .. } = *totals;
        let why = Why {
            statics: totals.static_pairs,
            unmoved: totals.unmoved_pairs,
            empty: totals.empty_pairs,
            cell: totals.cell_pairs,
            axis: totals.axis_pairs,
        };
        let pairs = why.named().iter().fold(0, |sum: u64, (_, pairs)| sum.saturating_add(*pairs));
        Self { boxes, pairs, why, zero_words: words }
    }
}

impl From<&SkipMeter> for Skipped {
    fn from(meter: &SkipMeter) -> Self {
        Self { pairs: meter.pairs, ..Self::from(&SkipTotals::of_frame(meter)) }
    }
}

impl Why {
    const fn named(&self) -> [(&'static str, u64); 5] {
        let Self { statics, unmoved, empty, cell, axis } = *self;
        [
            ("static", statics),
            ("unmoved", unmoved),
            ("empty", empty),
            ("cell", cell),
            ("axis", axis),
        ]
    }
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} boxes, {} pairs", self.boxes, self.pairs)?;
        let reasons = self.why.named().into_iter().filter(|(_, pairs)| *pairs > 0);
        for (i, (name, pairs)) in reasons.enumerate() {
            write!(f, "{}{name} {pairs}", if i == 0 { " (" } else { ", " })?;
        }
        let end = if self.why == Why::default() { "" } else { ")" };
        write!(f, "{end}, {} zero words", self.zero_words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_stand_behind_the_pairs_where_there_are_any() {
        assert_eq!(Skipped::default().to_string(), "0 boxes, 0 pairs, 0 zero words");
        let totals = SkipTotals {
            boxes: 1,
            unmoved_pairs: 2,
            axis_pairs: 3,
            words: 4,
            ..SkipTotals::default()
        };
        let text = Skipped::from(&totals).to_string();
        assert_eq!(text, "1 boxes, 5 pairs (unmoved 2, axis 3), 4 zero words");
    }
}
