//! Work that answers left out, as `cull` and `status` report it.

use std::fmt;

use pairmask_core::engine::SkipMeter;
use pairmask_wire::SkipTotals;
use serde::{Serialize, Serializer};

/// Work that was left out. Fields may be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Skipped {
    /// Boxes that were not looked at: they overlap nothing by themselves, or have not moved.
    boxes: u64,
    pairs: u64,
    /// Pairs that were never compared, by the first reason that holds: two static boxes, two that have not moved, an
    /// empty one, cells that are too far apart, the order along an axis.
    #[serde(serialize_with = "as_map")]
    why: [(&'static str, u64); 5],
    /// Words that were not written: zeros of masks; of scenes two for each pair that was reported before.
    zero_words: u64,
}

fn as_map<S: Serializer>(why: &[(&str, u64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(why.iter().copied())
}

impl From<&SkipTotals> for Skipped {
    fn from(totals: &SkipTotals) -> Self {
        let why = [
            ("static", totals.static_pairs),
            ("unmoved", totals.unmoved_pairs),
            ("empty", totals.empty_pairs),
            ("cell", totals.cell_pairs),
            ("axis", totals.axis_pairs),
        ];
        let pairs = why.iter().fold(0, |sum: u64, (_, pairs)| sum.saturating_add(*pairs));
        Self { boxes: totals.boxes, pairs, why, zero_words: totals.words }
    }
}

impl From<&SkipMeter> for Skipped {
    fn from(meter: &SkipMeter) -> Self {
        Self { pairs: meter.pairs, ..Self::from(&SkipTotals::of_frame(meter)) }
    }
}

impl Default for Skipped {
    fn default() -> Self {
        Self::from(&SkipTotals::default())
    }
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} boxes, {} pairs", self.boxes, self.pairs)?;
        let reasons = self.why.iter().filter(|(_, pairs)| *pairs > 0);
        let reasons: Vec<_> = reasons.map(|(name, pairs)| format!("{name} {pairs}")).collect();
        if !reasons.is_empty() {
            write!(f, " ({})", reasons.join(", "))?;
        }
        write!(f, ", {} zero words", self.zero_words)
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
