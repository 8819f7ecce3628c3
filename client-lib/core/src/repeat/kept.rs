//! Boxes and answer of a frame.

use std::time::Instant;

use super::sample::Facts;
use crate::bytes;
use crate::dispatch::{CullAnswer, StageTimes, nanoseconds_since};
use crate::engine::{CullReport, EngineTimes, ReplyBuffer, SkipMeter};
use crate::objects::Objects;
use crate::units::BoxCount;

/// Most bytes of boxes and mask that are copied of a session's frame: five million boxes with as many pairs
/// in a list. Frames beyond take so long that a client does better with a scene that persists.
pub(super) const MOST_BYTES: usize = 256 << 20;

/// A frame that was answered.
#[derive(Debug)]
pub(super) struct Kept {
    facts: Facts,
    objects: Vec<u8>,
    /// The reply, as far as the mask and what stands behind it reach.
    words: Vec<u32>,
    behind: u64,
    answer: CullAnswer,
    was_used: bool,
}

impl Kept {
    /// A copy. `None` where it would be too large, there is no memory for it, or the frame is not the one
    /// of these facts.
    pub(super) fn new(
        facts: Facts,
        objects: Objects<'_>,
        words: &[u32],
        answer: &CullAnswer,
        behind: u64,
    ) -> Option<Self> {
        let extent = answer.report.shape.extent_words().checked_add(behind)?;
        let extent = usize::try_from(extent).ok()?;
        let (objects_bytes, words) = (objects.as_bytes(), words.get(..extent)?);
        if !facts.is_of(objects) || objects_bytes.len() + size_of_val(words) > MOST_BYTES {
            return None;
        }
        let (objects, words) = (copied(objects_bytes)?, copied(words)?);
        Some(Self { facts, objects, words, behind, answer: *answer, was_used: false })
    }

    /// Bytes that are allocated.
    pub(super) const fn allocated_bytes(&self) -> usize {
        self.objects.capacity() + self.words.capacity() * size_of::<u32>()
    }

    /// Words that stand behind the mask.
    pub(super) const fn words_behind(&self) -> u64 {
        self.behind
    }

    /// Whether it has answered a frame.
    pub(super) const fn was_used(&self) -> bool {
        self.was_used
    }

    /// The answer to a frame that is equal to this one, with its mask in the reply. `None` where it is not
    /// equal, or its reply has no room.
    pub(super) fn answer_again(
        &mut self,
        facts: &Facts,
        objects: Objects<'_>,
        threads: Option<usize>,
        reply: &mut dyn ReplyBuffer,
    ) -> Option<CullAnswer> {
        let start = Instant::now();
        let is_shared = threads != Some(1);
        if self.facts != *facts || !bytes::are_equal(objects.as_bytes(), &self.objects, is_shared) {
            return None;
        }
        let ingest_ns = nanoseconds_since(start);
        let room = reply.reserve(self.words.len() as u64).ok()?;
        bytes::copy(&self.words, room.get_mut(..self.words.len())?, is_shared);
        self.was_used = true;
        let total_ns = nanoseconds_since(start);
        let publish_ns = total_ns - ingest_ns;
        let CullAnswer { engine, threads, report, .. } = self.answer;
        let n = BoxCount::of_len(objects.len())?;
        Some(CullAnswer {
            engine,
            threads,
            report: CullReport {
                skipped: SkipMeter::of_repeat(n, &report.skipped),
                times: EngineTimes { ingest_ns, execute_ns: 0, publish_ns },
                ..report
            },
            times: StageTimes { ingest_ns, plan_ns: 0, execute_ns: 0, publish_ns, total_ns },
        })
    }
}

/// A copy, or `None` where there is no memory for one.
fn copied<T: Copy>(items: &[T]) -> Option<Vec<T>> {
    let mut copy = Vec::new();
    copy.try_reserve_exact(items.len()).ok()?;
    copy.extend_from_slice(items);
    Some(copy)
}
