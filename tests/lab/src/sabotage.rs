//! Engines broken on purpose, by hidden flags and tests: `stress` and the auditor have to notice.

use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, EngineName, HeapReply, ReplyBuffer,
};
use pairmask_core::mask::MaskShape;
use pairmask_core::{Aabb, BoxClass};

/// Takes one pair out of a mask and out of its report. A mask whose words hold one pair each stays
/// unchanged: only a pair must be wrong, and a sparse word must not become zero.
pub fn lose_a_pair(words: &mut [u32], report: &mut CullReport) {
    let bits = match &mut report.shape {
        MaskShape::List { pairs } => {
            // One whose first box has another pair, too, as with words below; the last one moves there.
            let (start, len) = (pairs.start as usize, pairs.len as usize);
            let list = words.get_mut(start..start + len).unwrap_or_default().as_chunks_mut().0;
            let lost = list.windows(2).rposition(|two: &[[u32; 2]]| two[0][0] == two[1][0]);
            if let (Some(lost), Some(&last)) = (lost, list.last()) {
                list[lost] = last;
                pairs.len -= 2;
                report.pair_count = report.pair_count.saturating_sub(1);
            }
            return;
        }
        MaskShape::Dense { words } => words,
        MaskShape::Sparse { bits, .. } => bits,
        _ => return,
    };
    let (start, len) = (bits.start as usize, bits.len as usize);
    let bits = words.get_mut(start..).unwrap_or_default().iter_mut().take(len);
    if let Some(word) = bits.rev().find(|word| word.count_ones() > 1) {
        *word &= *word - 1;
        report.pair_count = report.pair_count.saturating_sub(1);
    }
}

/// The part that is broken on purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Sabotage {
    /// Every engine loses a pair of most frames.
    #[default]
    Lossy,
    /// Precision modes round boxes inward.
    Inward,
}

/// A box whose faces lie one step of f32 further inward, where it stays valid.
pub fn shrink(b: &Aabb) -> Aabb {
    let smaller = Aabb { min: b.min.map(f32::next_up), max: b.max.map(f32::next_down) };
    if smaller.class() == BoxClass::Valid { smaller } else { *b }
}

pub struct Spoiler<S> {
    pub engine: Box<dyn Engine>,
    /// The change of the reply and its report, for instance [`lose_a_pair`].
    pub spoil: S,
}

impl<S: FnMut(&mut [u32], &mut CullReport) + Send> Engine for Spoiler<S> {
    fn name(&self) -> EngineName {
        self.engine.name()
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let mut right = HeapReply::new();
        let mut report = self.engine.cull(input, &mut right)?;
        let right = right.words();
        let words = &mut reply.reserve(right.len() as u64)?[..right.len()];
        words.copy_from_slice(right);
        (self.spoil)(words, &mut report);
        Ok(report)
    }
}
