//! Engines broken on purpose, to see that `stress` and the auditor notice. Only hidden flags and
//! tests lead here.

use pairmask::Aabb;
use pairmask::engine::{
    CullError, CullJob, CullReport, Engine, EngineName, HeapReply, ReplyBuffer,
};
use pairmask::mask::MaskShape;

/// Takes one pair out of a mask and out of its report. A mask whose words hold one pair each stays
/// as it is: nothing but a pair is to be wrong, and a sparse word may not become zero.
pub fn lose_a_pair(words: &mut [u32], report: &mut CullReport) {
    let bits = match &report.shape {
        MaskShape::Dense { words } => words,
        MaskShape::Sparse { bits, .. } => bits,
    };
    let (start, len) = (bits.start as usize, bits.len as usize);
    let bits = words.get_mut(start..).unwrap_or_default().iter_mut().take(len);
    if let Some(word) = bits.rev().find(|word| word.count_ones() > 1) {
        *word &= *word - 1;
        report.pair_count = report.pair_count.saturating_sub(1);
    }
}

/// An engine that loses a pair of most frames.
pub struct Lossy(pub Box<dyn Engine>);

impl Engine for Lossy {
    fn name(&self) -> EngineName {
        self.0.name()
    }

    fn cull(
        &mut self,
        boxes: &[Aabb],
        job: &CullJob,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let mut right = HeapReply::new();
        let mut report = self.0.cull(boxes, job, &mut right)?;
        let right = right.words();
        let words = reply.reserve(right.len() as u64)?;
        words[..right.len()].copy_from_slice(right);
        lose_a_pair(words, &mut report);
        Ok(report)
    }
}
