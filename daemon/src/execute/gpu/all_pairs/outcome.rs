//! What the batches of a run reported, added up, and made into the engine's report.

use std::time::Duration;

use pairmask_core::aabb::KeyBox;
use pairmask_core::engine::{
    Census, CullError, CullReport, EngineTimes, NAMED_INVALID, ReplyBuffer, write_no_pairs,
};
use pairmask_core::mask::MaskShape;
use pairmask_core::objects::Objects;
use pairmask_core::{BoxCount, Encoding, MaskWord};
use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::BatchReport;

use super::plan::Counted;

/// What a run said, summed over its batches.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::execute::gpu) struct Outcome {
    pub(in crate::execute::gpu) census: Census,
    /// Non-zero mask words.
    pub(in crate::execute::gpu) words: u64,
    pub(in crate::execute::gpu) pairs: u64,
}

impl Outcome {
    /// The sum of all batches, in order.
    pub(in crate::execute::gpu) fn of(reports: &[BatchReport]) -> Self {
        let mut outcome = Self { census: Census::default(), words: 0, pairs: 0 };
        for (batch, first) in reports.iter().zip((0..).step_by(BATCH_BOXES as usize)) {
            outcome.words += u64::from(batch.words);
            outcome.pairs += u64::from(batch.pairs);
            outcome.census.empty += batch.empty;
            for (bits, place) in batch.invalid.iter().zip((0u32..).step_by(32)) {
                let census = &mut outcome.census;
                let named = census.named_invalid().len();
                let indices = MaskWord(*bits).bits().map(|bit| first + place + bit);
                for (slot, index) in
                    census.first_invalid[named..NAMED_INVALID].iter_mut().zip(indices)
                {
                    *slot = index;
                }
                census.invalid += bits.count_ones();
            }
        }
        outcome
    }

    /// What a mask of a kind holds: words, or pairs.
    pub(in crate::execute::gpu) const fn items(&self, counted: Counted) -> u64 {
        match counted {
            Counted::Sparse => self.words,
            Counted::List => self.pairs,
        }
    }
}

/// The answer for fewer than two boxes: nothing for a GPU to do.
pub(in crate::execute::gpu) fn no_pairs(
    n: BoxCount,
    objects: Objects<'_>,
    encoding: Encoding,
    reply: &mut dyn ReplyBuffer,
) -> Result<CullReport, CullError> {
    let mut census = Census::default();
    for index in 0..objects.len() {
        let class = match objects {
            Objects::Boxes(boxes) => boxes.get(index).map(|b| KeyBox::classify(&b).1),
            Objects::Spheres(spheres) => spheres.get(index).map(|sphere| { *sphere }.class()),
        };
        if let Some(class) = class {
            census.note(index as u32, class);
        }
    }
    let shape = write_no_pairs(n, encoding, reply)?;
    let outcome = Outcome { census, words: 0, pairs: 0 };
    Ok(report(n, shape, &outcome, [Duration::ZERO; 3]))
}

/// The report of a frame; the times are since its start.
pub(in crate::execute::gpu) fn report(
    n: BoxCount,
    shape: MaskShape,
    outcome: &Outcome,
    [ingested, executed, published]: [Duration; 3],
) -> CullReport {
    let ns = |d: Duration| d.as_nanos() as u64;
    let times = EngineTimes {
        ingest_ns: ns(ingested),
        execute_ns: ns(executed.saturating_sub(ingested)),
        publish_ns: ns(published.saturating_sub(executed)),
    };
    // Every pair is compared.
    CullReport::new(n, shape, outcome.census, outcome.pairs, n.pair_count(), times)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_add_up_and_the_first_invalid_boxes_are_named_in_order() {
        let mut reports = [BatchReport::default(); 3];
        for (batch, word, bits) in [(0, 7, 1 << 31), (1, 0, 0b101), (1, 3, u32::MAX)] {
            reports[batch].invalid[word] = bits;
        }
        reports[2] = BatchReport { words: u32::MAX, pairs: u32::MAX, empty: 9, ..reports[2] };
        reports[0].words = 1;
        let outcome = Outcome::of(&reports);
        assert_eq!((outcome.words, outcome.pairs), (1 << 32, u64::from(u32::MAX)));
        assert_eq!((outcome.census.invalid, outcome.census.empty), (35, 9));
        assert_eq!(outcome.census.first_invalid, [255, 256, 258, 352, 353, 354, 355, 356]);
        assert_eq!(Outcome::of(&[]).census, Census::default());
    }
}
