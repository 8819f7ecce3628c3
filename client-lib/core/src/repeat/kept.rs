//! Boxes and answer of a frame.

use std::time::Instant;

use rayon::prelude::*;

use super::sample::Facts;
use crate::dispatch::{CullAnswer, StageTimes, nanoseconds_since};
use crate::engine::{CullReport, EngineTimes, ReplyBuffer, SkipMeter};
use crate::objects::Objects;
use crate::units::BoxCount;

/// Most bytes of boxes and mask that are copied of a session's frame: five million boxes with as many pairs
/// in a list. Frames beyond take so long that a client does better with a scene that persists.
pub(super) const MOST_BYTES: usize = 256 << 20;

/// Bytes that a thread compares or copies at a time: few enough that a difference ends the comparison soon,
/// and enough that handing the task over does not count (25 µs each).
const TASK_BYTES: usize = 256 << 10;

/// From so many bytes on, threads share the work: it takes 0.2 ms on one.
const SHARED_BYTES: usize = 2 << 20;

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
        if self.facts != *facts || !is_equal(objects.as_bytes(), &self.objects, is_shared) {
            return None;
        }
        let ingest_ns = nanoseconds_since(start);
        let room = reply.reserve(self.words.len() as u64).ok()?;
        copy(&self.words, room.get_mut(..self.words.len())?, is_shared);
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

/// Whether two ranges hold the same bytes. Stops at the first difference, or soon after.
fn is_equal(a: &[u8], b: &[u8], is_shared: bool) -> bool {
    if a.len() != b.len() {
        return false;
    }
    if !is_shared || a.len() < SHARED_BYTES {
        return a.chunks(TASK_BYTES).eq(b.chunks(TASK_BYTES));
    }
    a.par_chunks(TASK_BYTES).zip(b.par_chunks(TASK_BYTES)).all(|(a, b)| a == b)
}

fn copy(from: &[u32], to: &mut [u32], is_shared: bool) {
    if !is_shared || size_of_val(from) < SHARED_BYTES {
        return to.copy_from_slice(from);
    }
    let task_words = TASK_BYTES / size_of::<u32>();
    let tasks = to.par_chunks_mut(task_words).zip(from.par_chunks(task_words));
    tasks.for_each(|(to, from)| to.copy_from_slice(from));
}

/// A copy, or `None` where there is no memory for one.
fn copied<T: Copy>(items: &[T]) -> Option<Vec<T>> {
    let mut copy = Vec::new();
    copy.try_reserve_exact(items.len()).ok()?;
    copy.extend_from_slice(items);
    Some(copy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_anywhere_is_a_difference() {
        for len in [1, 24, TASK_BYTES, TASK_BYTES + 1, SHARED_BYTES + 24, 5 * TASK_BYTES - 7] {
            let a: Vec<u8> = (0..len).map(|i| (i * 7) as u8).collect();
            let mut b = a.clone();
            for is_shared in [false, true] {
                assert!(is_equal(&a, &b, is_shared), "{len}");
                for at in [0, len / 3, len - 1] {
                    b[at] ^= 0x80;
                    assert!(!is_equal(&a, &b, is_shared), "{len} at {at}");
                    b[at] ^= 0x80;
                }
                assert!(!is_equal(&a, &b[..len - 1], is_shared), "{len} and one less");
            }
        }
        assert!(is_equal(&[], &[], true));
    }

    #[test]
    fn a_copy_in_parts_is_whole() {
        for len in [0, 1, 1_000, SHARED_BYTES / 4 + 3] {
            let from: Vec<u32> = (0..len as u32).map(|i| i ^ 0x5a5a).collect();
            for is_shared in [false, true] {
                let mut to = vec![u32::MAX; len];
                copy(&from, &mut to, is_shared);
                assert!(to == from, "{len}");
            }
        }
    }
}
