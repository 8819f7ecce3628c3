//! A frame that is equal to the last one, answered without an engine.
//!
//! Games pause, menus open, turns wait: then the same boxes come again and again. A frame whose boxes and
//! options are byte-identical with the last one's has the last one's answer.
//!
//! Scenes that move pay next to nothing: of each frame a sample of a few boxes is remembered and compared,
//! which differs at its first box where all boxes move. Only where the sample is equal, boxes and answer
//! are copied, and later frames are compared with the copy as a whole. A copy that never answered a frame,
//! because a box moves that is not in the sample, doubles the number of equal samples before the next one.
//!
//! Bits are compared: −0 and +0 differ, equal NaNs do not. Each byte is read once for the comparison and
//! once for the copy: a client that changes its frame under way may get the answer to one of its frames
//! before, with indices below its own number of boxes, and never that of another session.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use crate::bytes;
use crate::dispatch::{CullAnswer, CullOptions, StageTimes, nanoseconds_since};
use crate::engine::{CullReport, EngineChoice, EngineTimes, ReplyBuffer, SkipMeter};
use crate::objects::{ObjectForm, Objects};
use crate::units::BoxCount;

/// Boxes in the sample of a frame that differs from the one before: to read them takes under 0.1 µs.
const FEW: usize = 4;
/// Boxes in the sample of a frame that looks equal: one moving box in fifty is seen by most such samples.
const MANY: usize = 66;
/// A sample has at most one box in so many, beyond the first few, to stay cheap beside a cull of 64 boxes.
const A_SAMPLED_BOX: usize = 16;
/// Bytes of the largest object.
const SLOT_BYTES: usize = 24;
/// Most bytes of boxes and mask that are copied: five million boxes with as many pairs in a list.
const MOST_BYTES: usize = 256 << 20;
/// Most equal samples that are asked for before a copy, which takes about as long as a cull at worst.
const MOST_EQUAL: u32 = 1_024;

/// Whether so many objects are compared, and their answer copied, sooner than an engine that is predicted
/// to take `engine_ns` culls them. Those of a CPU always take longer; a GPU may not.
pub fn is_sooner_compared(objects: Objects<'_>, threads: usize, engine_ns: u64) -> bool {
    // About one pair an object, 8 bytes in a list. A thread compares 10 bytes a nanosecond in ranges that no
    // cache holds; those beyond eight share the memory.
    let bytes = objects.len() * (objects.form().object_bytes() + 8);
    (bytes as f64 / (10.0 * threads.clamp(1, 8) as f64)) < engine_ns as f64
}

/// What else decides an answer: form, count, options without threads, room of the reply, number of the rules.
type Facts = (ObjectForm, usize, CullOptions, u64, u64);

/// What is remembered of a session's last frame.
#[derive(Debug, Default)]
pub struct Repeats {
    facts: Option<Facts>,
    /// Sampled objects, as far as they were taken.
    sample: Vec<[u8; SLOT_BYTES]>,
    /// Frames in a row whose sample was equal, and how many make a copy worth it.
    equal_count: u32,
    requested_log2: u32,
    copy: Option<Box<FrameCopy>>,
    /// Where a copy will be found that is being made.
    promised: Option<Arc<Promise>>,
}

/// Where a copy is left: the frame may end on another thread than the one that began it.
type Promise = Mutex<Option<Box<FrameCopy>>>;

/// What a look at a frame showed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // A box would be an allocation.
pub enum Seen {
    /// It is equal to the last one, whose answer is in the reply.
    Answered(CullAnswer),
    /// It may be equal to the last one, and so may the next be: its answer is worth [a copy](Repeats::ticket).
    Alike,
    /// It is to be culled.
    New,
}

impl Repeats {
    /// Looks at a frame with the rules of a number: 0 where all boxes may meet, and another one for other
    /// rules. Where it is equal to the last one, the reply gets that one's mask. Frames of a client that names
    /// an engine are always new: it needs that engine to work.
    pub fn look(
        &mut self,
        objects: Objects<'_>,
        options: &CullOptions,
        rules: u64,
        reply: &mut dyn ReplyBuffer,
    ) -> Seen {
        if options.engine != EngineChoice::Auto || objects.len() < 2 {
            self.discard();
            return Seen::New;
        }
        let settled = CullOptions { last_pairs: None, threads: None, ..*options };
        let facts = (objects.form(), objects.len(), settled, reply.limit_words(), rules);
        let mut sampled = self.sample.iter().enumerate();
        if self.facts != Some(facts) || !sampled.all(|(k, slot)| *slot == sample_of(objects, k)) {
            self.drop_copy();
            self.facts = Some(facts);
            self.sample.clear();
            self.sample.extend((0..FEW).map(|k| sample_of(objects, k)));
            return Seen::New;
        }
        let count = MANY.min(FEW.max(objects.len() / A_SAMPLED_BOX));
        self.sample.extend((self.sample.len()..count).map(|k| sample_of(objects, k)));
        if let Some(promise) = &self.promised {
            let done = promise.lock().unwrap_or_else(PoisonError::into_inner).take();
            if done.is_none() && Arc::strong_count(promise) > 1 {
                // The frame is still under way.
                return Seen::New;
            }
            (self.copy, self.promised) = (done, None);
        }
        let Some(copy) = &mut self.copy else {
            self.equal_count = self.equal_count.saturating_add(1);
            return if self.equal_count >> self.requested_log2 > 0 {
                Seen::Alike
            } else {
                Seen::New
            };
        };
        if let Some(answer) = copy.answer_again(&facts, objects, options.threads, reply) {
            return Seen::Answered(answer);
        }
        self.drop_copy();
        Seen::New
    }

    /// A promise to copy the frame that was looked at last, once it is culled; `None` where it is too large.
    pub fn ticket(&mut self) -> Option<KeepTicket> {
        let of_room = |(form, n, ..): &Facts| n.saturating_mul(form.object_bytes()) <= MOST_BYTES;
        let facts = self.facts.filter(of_room)?;
        let promise = Arc::new(Promise::default());
        self.promised = Some(Arc::clone(&promise));
        Some(KeepTicket { facts, promise })
    }

    /// Words behind the mask that were copied with it.
    pub fn words_behind(&self) -> u64 {
        self.copy.as_ref().map_or(0, |copy| copy.behind)
    }

    /// Gives the copy up, and all else that is known of the last frame.
    pub fn discard(&mut self) {
        self.facts = None;
        self.drop_copy();
    }

    /// Bytes that are allocated for the copy.
    pub fn allocated_bytes(&self) -> usize {
        self.copy.as_ref().map_or(0, |copy| copy.objects.len() + size_of_val(&*copy.words))
    }

    fn drop_copy(&mut self) {
        self.equal_count = 0;
        let was_promised = self.promised.take().map(|_| false);
        if let Some(was_used) = self.copy.take().map(|copy| copy.was_used).or(was_promised) {
            let requested = self.requested_log2;
            self.requested_log2 = if was_used {
                requested.saturating_sub(1)
            } else {
                MOST_EQUAL.ilog2().min(requested + 1)
            };
        }
    }
}

/// The object at place `k` of a frame's sample, filled up with zeros: the first, the last, then others all over.
fn sample_of(objects: Objects<'_>, k: usize) -> [u8; SLOT_BYTES] {
    let (n, bytes) = (objects.len(), objects.form().object_bytes());
    // The fractional parts of multiples of the golden ratio are spread evenly.
    let fraction = u128::from((k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let index = if k == 1 { n - 1 } else { ((fraction * n as u128) >> 64) as usize };
    let mut slot = [0; SLOT_BYTES];
    slot[..bytes].copy_from_slice(&objects.as_bytes()[index * bytes..][..bytes]);
    slot
}

/// A promise to copy boxes and answer of a frame.
#[derive(Debug)]
pub struct KeepTicket {
    facts: Facts,
    promise: Arc<Promise>,
}

impl KeepTicket {
    /// Copies the objects of the frame and its answer, whose mask `words` hold with so many words behind it,
    /// where there is memory for them.
    pub fn keep(self, objects: Objects<'_>, words: &[u32], answer: &CullAnswer, behind: u64) {
        let copy = FrameCopy::new(self.facts, objects, words, answer, behind);
        *self.promise.lock().unwrap_or_else(PoisonError::into_inner) = copy.map(Box::new);
    }
}

/// A frame that was answered.
#[derive(Debug)]
struct FrameCopy {
    facts: Facts,
    objects: Vec<u8>,
    /// The reply, as far as the mask and what stands behind it reach.
    words: Vec<u32>,
    behind: u64,
    answer: CullAnswer,
    was_used: bool,
}

impl FrameCopy {
    /// `None` where it would be too large, there is no memory for it, or the frame is not that of the facts.
    fn new(
        facts: Facts,
        objects: Objects<'_>,
        words: &[u32],
        answer: &CullAnswer,
        behind: u64,
    ) -> Option<Self> {
        let extent = answer.report.shape.extent_words().checked_add(behind)?;
        let (bytes, words) = (objects.as_bytes(), words.get(..usize::try_from(extent).ok()?)?);
        let is_of_facts = (facts.0, facts.1) == (objects.form(), objects.len());
        if !is_of_facts || bytes.len() + size_of_val(words) > MOST_BYTES {
            return None;
        }
        let (objects, words) = (copied(bytes)?, copied(words)?);
        Some(Self { facts, objects, words, behind, answer: *answer, was_used: false })
    }

    /// The answer to a frame that is equal to this one, with its mask in the reply. `None` where it is not
    /// equal, or its reply has no room.
    fn answer_again(
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
        let (n, report) = (BoxCount::of_len(objects.len())?, self.answer.report);
        let skipped = SkipMeter::of_repeat(n, &report.skipped);
        let stages = EngineTimes { ingest_ns, execute_ns: 0, publish_ns };
        let report = CullReport { skipped, times: stages, ..report };
        let times = StageTimes { ingest_ns, publish_ns, total_ns, ..StageTimes::default() };
        Some(CullAnswer { report, times, expected_ns: 0, ..self.answer })
    }
}

/// A copy, or `None` where there is no memory for one.
fn copied<T: Copy>(entries: &[T]) -> Option<Vec<T>> {
    let mut copy = Vec::new();
    copy.try_reserve_exact(entries.len()).ok()?;
    copy.extend_from_slice(entries);
    Some(copy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::dispatch::CpuEngines;
    use crate::engine::HeapReply;
    use crate::mask::MaskView;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_frames_have_the_answers_of_fresh_engines(
            n in 2usize..150,
            steps in prop::collection::vec((0usize..300, 0usize..6, 0u32..32), 1..40),
        ) {
            let box_at = |i| Aabb::new([i as f32, 0.0, -0.0], [i as f32 + 1.0, 1.0, 1.0]);
            let mut boxes: Vec<Aabb> = (0..n).map(box_at).collect();
            let (mut repeats, options) = (Repeats::default(), CullOptions::default());
            let (mut reply, mut fresh) = (HeapReply::new(), HeapReply::new());
            let of = |words: &[u32], answer: &CullAnswer| {
                let n = BoxCount::of_len(n).expect("few");
                MaskView::new(n, &answer.report.shape, words).expect("as it was written").to_vec()
            };
            for (at, component, bit) in steps {
                if at < n {
                    let numbers: &mut [u32] = bytemuck::cast_slice_mut(&mut boxes[at..=at]);
                    numbers[component] ^= 1 << bit;
                }
                let expected = CpuEngines::new().cull(&boxes, &options, &mut fresh).expect("few");
                let objects = Objects::Boxes((&boxes).into());
                let seen = repeats.look(objects, &options, 0, &mut reply);
                let (answer, words) = match seen {
                    Seen::Answered(answer) => (answer, reply.words().to_vec()),
                    _ => (expected, fresh.words().to_vec()),
                };
                prop_assert_eq!(of(&words, &answer), of(fresh.words(), &expected));
                if let (Seen::Alike, Some(ticket)) = (seen, repeats.ticket()) {
                    ticket.keep(objects, &words, &answer, 0);
                }
            }
        }
    }
}
