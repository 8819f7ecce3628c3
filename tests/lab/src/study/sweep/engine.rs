//! The sweep as an engine, so that the conformance suite runs it as it runs all others.

use pairmask_core::Encoding;
use pairmask_core::engine::PairSkips;
use pairmask_core::engine::{
    Census, CullError, CullInput, CullReport, Engine, EngineName, EngineTimes, ReplyBuffer,
    SkipMeter,
};
use pairmask_core::mask::MaskShape;

use super::device::{GpuSweep, SweepError};

/// The engine whose algorithm it is. The sweep has no name of its own: it serves no client.
const ENGINE: EngineName = EngineName::CpuSap;

impl Engine for GpuSweep {
    fn name(&self) -> EngineName {
        ENGINE
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, n) = input.f32_boxes(ENGINE)?;
        if input.encoding != Encoding::List {
            return Err(CullError::Unavailable { engine: ENGINE, why: "the sweep writes lists" });
        }
        let swept = self.pairs(boxes).map_err(|error| match error {
            SweepError::Gpu(_) => CullError::DeviceLost { engine: ENGINE },
            SweepError::TooCrowded => CullError::TooCrowded { engine: ENGINE },
        })?;
        // The device's order is that of its threads.
        let mut pairs = swept.pairs;
        pairs.sort_unstable();
        let words = pairs.as_flattened();
        reply.reserve(words.len() as u64)?[..words.len()].copy_from_slice(words);
        let pair_count = pairs.len() as u64;
        let census = Census::of(boxes);
        let left_out = u64::from(census.invalid) + u64::from(census.empty);
        let axis = n.pair_count().saturating_sub(swept.tested);
        Ok(CullReport {
            shape: MaskShape::list(pair_count),
            census,
            pair_count,
            skipped: SkipMeter {
                boxes: left_out,
                pairs: axis,
                why: PairSkips::of_frame(0, 0, axis),
                ..SkipMeter::default()
            },
            times: EngineTimes::default(),
        })
    }
}
